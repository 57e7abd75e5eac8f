#include "simulator/bridge/usbip_server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "protocol/base/log.h"

namespace mesorig::simulator {
namespace {

constexpr int kLook_ms = 100;
constexpr size_t kMostUrbs = 256;  // waiting ones

}  // namespace

StatusOr<std::unique_ptr<UsbipServer>> UsbipServer::Open(int port, std::string serial,
                                                         std::function<void(std::string)> out) {
  UniqueFd listener(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<uint16_t>(port));
  socklen_t size = sizeof(address);
  const int on = 1;
  ::setsockopt(listener.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  if (::bind(listener.get(), reinterpret_cast<const sockaddr*>(&address), size) != 0 ||
      ::listen(listener.get(), 8) != 0 ||
      ::getsockname(listener.get(), reinterpret_cast<sockaddr*>(&address), &size) != 0) {
    return Unavailable("USB/IP at 127.0.0.1:{}: {}", port, std::strerror(errno));
  }
  return std::unique_ptr<UsbipServer>(new UsbipServer(std::move(listener), ntohs(address.sin_port),
                                                      std::move(serial), std::move(out)));
}

UsbipServer::UsbipServer(UniqueFd listener, int port, std::string serial,
                         std::function<void(std::string)> out)
    : listener_(std::move(listener)),
      port_(port),
      device_(std::move(serial)),
      out_(std::move(out)) {
  thread_ = std::thread([this] { Accept(); });
}

UsbipServer::~UsbipServer() {
  ending_ = true;
  thread_.join();
}

void UsbipServer::Accept() {
  while (!ending_) {
    pollfd ready{listener_.get(), POLLIN, 0};
    if (::poll(&ready, 1, kLook_ms) <= 0) continue;
    const UniqueFd client(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
    if (client.get() < 0) continue;
    const int on = 1;
    const timeval patience{1, 0};  // with a client that takes nothing
    ::setsockopt(client.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    ::setsockopt(client.get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof(patience));
    Serve(client.get());
    MutexLock lock(mutex_);
    client_ = -1;
    urbs_.clear();
    packets_.clear();
  }
}

void UsbipServer::Serve(int client) {
  bool attached = false;
  Status status = AnswerRequest(client, attached);
  while (status.ok() && attached) status = AnswerUrb(client);
  if (!status.ok() && !absl::IsCancelled(status)) Log("link").warn("{}", Message(status));
}

StatusOr<std::string> UsbipServer::Read(int client, size_t size) {
  std::string bytes;
  while (bytes.size() < size) {
    if (ending_) return Cancelled("the server ends");
    pollfd ready{client, POLLIN, 0};
    if (::poll(&ready, 1, kLook_ms) <= 0) continue;
    std::string part(size - bytes.size(), '\0');
    const ssize_t got = ::read(client, part.data(), part.size());
    if (got <= 0) return Cancelled("the client left");
    bytes.append(part, 0, static_cast<size_t>(got));
  }
  return bytes;
}

Status UsbipServer::AnswerRequest(int client, bool& attached) {
  MESORIG_ASSIGN_OR_RETURN(const std::string head, Read(client, usbip::kRequestBytes));
  MESORIG_ASSIGN_OR_RETURN(const usbip::Request request, usbip::ParseRequest(head));
  std::string reply = usbip::DeviceListReply(device_.identity());
  if (request == usbip::Request::kImport) {
    MESORIG_ASSIGN_OR_RETURN(const std::string id, Read(client, usbip::kBusIdBytes));
    attached = id.c_str() == device_.identity().bus_id;
    reply = usbip::ImportReply(device_.identity(), attached);
  }
  MutexLock lock(mutex_);
  client_ = client;
  Send(reply);
  return OkStatus();
}

Status UsbipServer::AnswerUrb(int client) {
  MESORIG_ASSIGN_OR_RETURN(const std::string header, Read(client, usbip::kUrbHeaderBytes));
  MESORIG_ASSIGN_OR_RETURN(const usbip::Urb urb, usbip::ParseUrb(header));
  if (urb.unlink) {
    Unlink(urb);
    return OkStatus();
  }
  std::string data;
  if (!urb.in) {
    MESORIG_ASSIGN_OR_RETURN(data, Read(client, static_cast<size_t>(urb.size)));
  }
  Submit(urb, std::move(data));
  return OkStatus();
}

void UsbipServer::Submit(const usbip::Urb& urb, std::string data) {
  if (urb.endpoint == kNxtOut && !urb.in) {
    for (size_t at = 0; at < data.size(); at += kNxtPacketBytes) {
      out_(data.substr(at, kNxtPacketBytes));
    }
  }
  MutexLock lock(mutex_);
  if (urb.endpoint == 0) {
    const auto answer = device_.Control(urb.setup);
    const std::string in = answer ? answer->substr(0, static_cast<size_t>(urb.size)) : "";
    return Send(usbip::UrbReply(urb, answer ? 0 : -EPIPE, in, data.size()));
  }
  if (urb.endpoint == kNxtOut && !urb.in) return Send(usbip::UrbReply(urb, 0, "", data.size()));
  if (urb.endpoint != kNxtIn || !urb.in || urbs_.size() >= kMostUrbs) {
    return Send(usbip::UrbReply(urb, -EPIPE, ""));
  }
  urbs_.push_back(urb);
  Match();
}

void UsbipServer::Unlink(const usbip::Urb& urb) {
  MutexLock lock(mutex_);
  const auto waiting = std::find_if(urbs_.begin(), urbs_.end(), [&](const usbip::Urb& other) {
    return other.number == urb.unlinked;
  });
  const bool was_waiting = waiting != urbs_.end();
  if (was_waiting) urbs_.erase(waiting);
  Send(usbip::UnlinkReply(urb, was_waiting));
}

void UsbipServer::Deliver(std::string packet) {
  MutexLock lock(mutex_);
  if (client_ < 0) return;
  packets_.push_back(std::move(packet));
  if (packets_.size() > kMostWaiting) packets_.pop_front();
  Match();
}

void UsbipServer::Match() {
  while (!urbs_.empty() && !packets_.empty()) {
    const bool fits = packets_.front().size() <= static_cast<size_t>(urbs_.front().size);
    Send(usbip::UrbReply(urbs_.front(), fits ? 0 : -EOVERFLOW, fits ? packets_.front() : ""));
    urbs_.pop_front();
    packets_.pop_front();
  }
}

void UsbipServer::Send(const std::string& message) {
  for (size_t done = 0; done < message.size();) {
    const ssize_t n = ::send(client_, message.data() + done, message.size() - done, MSG_NOSIGNAL);
    if (n <= 0) return;  // the reader hears of it
    done += static_cast<size_t>(n);
  }
}

}  // namespace mesorig::simulator
