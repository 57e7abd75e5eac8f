#include "simulator/bridge/modbus_bridge.h"

#include <absl/strings/numbers.h>
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <termios.h>

#include <cerrno>
#include <chrono>
#include <cstring>

#include "protocol/base/log.h"

namespace mesorig::simulator {
namespace {

constexpr int kSilence_ms = 20;   // generous: 3.5 characters are 2 ms at 19200 bit/s
constexpr int kPatience_ms = 900;  // for the slave
constexpr size_t kHeader = 6;     // of Modbus TCP: transaction, protocol, length

// Exactly `size` bytes, or none.
std::string ReadWhole(int fd, size_t size, std::chrono::steady_clock::time_point until) {
  std::string bytes;
  while (bytes.size() < size) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(
        until - std::chrono::steady_clock::now());
    pollfd ready{fd, POLLIN, 0};
    if (left.count() <= 0 || ::poll(&ready, 1, static_cast<int>(left.count())) <= 0) return {};
    std::string part(size - bytes.size(), '\0');
    const ssize_t got = ::read(fd, part.data(), part.size());
    if (got <= 0) return {};
    bytes.append(part, 0, static_cast<size_t>(got));
  }
  return bytes;
}

}  // namespace

StatusOr<std::unique_ptr<ModbusBridge>> ModbusBridge::Open(const std::string& link,
                                                           const std::string& slave) {
  int port = 0;
  if (!absl::SimpleAtoi(slave.substr(slave.rfind(':') + 1), &port)) {
    return InvalidArgument("Modbus slave \"{}\" is not HOST:PORT", slave);
  }
  UniqueFd terminal(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK));
  termios raw{};
  if (terminal.get() < 0 || ::grantpt(terminal.get()) != 0 || ::unlockpt(terminal.get()) != 0 ||
      ::tcgetattr(terminal.get(), &raw) != 0) {
    return Unavailable("a pseudo-terminal: {}", std::strerror(errno));
  }
  ::cfmakeraw(&raw);
  char name[128];
  struct stat there {};
  if (::tcsetattr(terminal.get(), TCSANOW, &raw) != 0 ||
      ::ptsname_r(terminal.get(), name, sizeof(name)) != 0) {
    return Unavailable("a pseudo-terminal: {}", std::strerror(errno));
  }
  // (A link that a killed one left is stale; anything else is somebody's.)
  if (::lstat(link.c_str(), &there) == 0 && S_ISLNK(there.st_mode)) ::unlink(link.c_str());
  if (::symlink(name, link.c_str()) != 0) return Unavailable("{}: {}", link, std::strerror(errno));
  return std::unique_ptr<ModbusBridge>(new ModbusBridge(link, port, std::move(terminal)));
}

ModbusBridge::ModbusBridge(std::string link, int port, UniqueFd terminal)
    : link_(std::move(link)), port_(port), terminal_(std::move(terminal)) {
  thread_ = std::thread([this] { Serve(); });
}

ModbusBridge::~ModbusBridge() {
  ending_ = true;
  thread_.join();
  ::unlink(link_.c_str());
}

void ModbusBridge::Serve() {
  while (!ending_) {
    pollfd ready{terminal_.get(), POLLIN, 0};
    const int events = ::poll(&ready, 1, kSilence_ms);
    if (events <= 0) {
      framer_.Silence();
      continue;
    }
    char bytes[512];
    const ssize_t got = ::read(terminal_.get(), bytes, sizeof(bytes));
    if (got <= 0) {  // nobody has it open
      std::this_thread::sleep_for(std::chrono::milliseconds(kSilence_ms));
      continue;
    }
    framer_.Feed({bytes, static_cast<size_t>(got)});
    while (const auto request = framer_.Next()) Answer(*request);
  }
}

void ModbusBridge::Answer(const std::string& request) {
  const std::string reply = Ask(request);
  if (reply.empty()) return;
  const std::string frame = WithRtuChecksum(reply);
  if (::write(terminal_.get(), frame.data(), frame.size()) != static_cast<ssize_t>(frame.size())) {
    Log("link").warn("Modbus {}: {}", link_, std::strerror(errno));
  }
}

bool ModbusBridge::ConnectSlave() {
  if (slave_.get() >= 0) return true;
  UniqueFd fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<uint16_t>(port_));
  const int on = 1;
  ::setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  if (::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    return false;
  }
  slave_ = std::move(fd);
  return true;
}

std::string ModbusBridge::Ask(const std::string& request) {
  if (!ConnectSlave()) return {};
  ++transaction_;
  std::string message{static_cast<char>(transaction_ >> 8), static_cast<char>(transaction_ & 0xFF),
                      '\0', '\0', static_cast<char>(request.size() >> 8),
                      static_cast<char>(request.size() & 0xFF)};
  message += request;
  const auto until =
      std::chrono::steady_clock::now() + std::chrono::milliseconds(kPatience_ms);
  if (::send(slave_.get(), message.data(), message.size(), MSG_NOSIGNAL) ==
      static_cast<ssize_t>(message.size())) {
    const std::string header = ReadWhole(slave_.get(), kHeader, until);
    const size_t size = header.empty() ? 0
                                       : static_cast<uint8_t>(header[4]) * 256u +
                                             static_cast<uint8_t>(header[5]);
    if (size > 0 && header.substr(0, 2) == message.substr(0, 2)) {
      if (std::string reply = ReadWhole(slave_.get(), size, until); !reply.empty()) return reply;
    }
  }
  slave_ = UniqueFd();  // an answer that comes late is nobody's
  return {};
}

}  // namespace mesorig::simulator
