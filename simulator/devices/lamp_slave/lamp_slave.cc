#include "simulator/devices/lamp_slave/lamp_slave.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <vector>

#include "protocol/base/log.h"

namespace mesorig::simulator {
namespace {

struct MappingDeleter {
  void operator()(modbus_mapping_t* mapping) const { modbus_mapping_free(mapping); }
};

// port 0: any. Invalid: errno says why.
sim_wire::Fd ListenOn(int& port) {
  sim_wire::Fd fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const int on = 1;
  ::setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<uint16_t>(port));
  socklen_t size = sizeof(address);
  if (!fd.valid() ||
      ::bind(fd.get(), reinterpret_cast<sockaddr*>(&address), sizeof(address)) != 0 ||
      ::listen(fd.get(), 4) != 0 ||
      ::getsockname(fd.get(), reinterpret_cast<sockaddr*>(&address), &size) != 0) {
    return {};
  }
  port = ntohs(address.sin_port);
  return fd;
}

}  // namespace

StatusOr<std::unique_ptr<LampSlave>> LampSlave::Listen(LampBankModel& bank, int unit,
                                                       FaultyDevice* wire) {
  int port = 0;
  sim_wire::Fd listener = ListenOn(port);
  if (!listener.valid()) {
    return Unavailable("lamp bank: cannot listen on 127.0.0.1: {}", strerror(errno));
  }
  return std::unique_ptr<LampSlave>(new LampSlave(bank, unit, wire, port, std::move(listener)));
}

LampSlave::LampSlave(LampBankModel& bank, int unit, FaultyDevice* wire, int port,
                     sim_wire::Fd listener)
    : bank_(bank),
      unit_(unit),
      wire_(wire),
      port_(port),
      endpoint_(fmt::format("127.0.0.1:{}", port)),
      context_(modbus_new_tcp("127.0.0.1", 0), &modbus_free),
      listener_(std::move(listener)) {
  int fds[2];
  if (::pipe2(fds, O_CLOEXEC) == 0) {
    wake_read_ = sim_wire::Fd(fds[0]);
    wake_write_ = sim_wire::Fd(fds[1]);
  }
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, fds) == 0) {
    captured_ = sim_wire::Fd(fds[0]);
    capture_ = sim_wire::Fd(fds[1]);
  }
  modbus_set_slave(context_.get(), unit_);
  modbus_set_response_timeout(context_.get(), 0, 1000);  // (it sleeps so long on a bad request)
  bank_.OnClose([this] { CloseAll(); });
  bank_.OnPlug([this](bool plugged) { SetPlugged(plugged); });
  if (wire_ != nullptr) wire_->OnLate([this](const std::string& late) { SendLate(late); });
}

LampSlave::~LampSlave() {
  if (!thread_.joinable()) return;
  wake_write_.Close();  // the reader's end shows it
  thread_.join();
}

void LampSlave::Start(sim_wire::SimServer& server) {
  server_ = &server;
  thread_ = std::thread([this] { Serve(); });
}

void LampSlave::Wake() {
  const char byte = 0;
  [[maybe_unused]] const ssize_t n = ::write(wake_write_.get(), &byte, 1);
}

void LampSlave::CloseAll() {
  const MutexLock lock(mutex_);
  for (const auto& master : masters_) ::shutdown(master->fd.get(), SHUT_RDWR);
}

void LampSlave::SetPlugged(bool plugged) {
  if (!plugged) CloseAll();
  {
    const MutexLock lock(mutex_);
    if (plugged) {
      int port = port_;
      listener_ = ListenOn(port);
      if (!listener_.valid()) {
        spdlog::error("lamp bank: cannot listen on {} again: {}", endpoint_, strerror(errno));
      }
    } else {
      // From here on connections are refused, also while the thread still polls.
      ::shutdown(listener_.get(), SHUT_RDWR);
      listener_.Close();
    }
  }
  Wake();
}

void LampSlave::Serve() {
  for (;;) {
    std::vector<pollfd> fds = {{wake_read_.get(), POLLIN, 0}};
    std::vector<Master*> masters;
    {
      const MutexLock lock(mutex_);
      fds.push_back({listener_.get(), POLLIN, 0});  // -1 is passed over
      for (const auto& master : masters_) {
        masters.push_back(master.get());
        fds.push_back({master->fd.get(), POLLIN, 0});
      }
    }
    if (::poll(fds.data(), fds.size(), -1) < 0 && errno != EINTR) return;
    if ((fds[0].revents & POLLIN) != 0) {
      char byte = 0;
      if (::read(wake_read_.get(), &byte, 1) <= 0) return;
    } else if (fds[0].revents != 0) {
      return;
    }
    for (size_t i = 0; i < masters.size(); ++i) {
      if (fds[i + 2].revents != 0) Receive(*masters[i]);
    }
    const MutexLock lock(mutex_);
    std::erase_if(masters_, [](const auto& master) { return !master->fd.valid(); });
    if ((fds[1].revents & POLLIN) != 0 && listener_.valid()) Accept();
  }
}

void LampSlave::Accept() {
  auto master = std::make_unique<Master>();
  master->fd = sim_wire::Fd(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
  const int on = 1;
  ::setsockopt(master->fd.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  if (master->fd.valid()) masters_.push_back(std::move(master));
}

void LampSlave::Receive(Master& master) {
  uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
  modbus_set_socket(context_.get(), master.fd.get());
  const int size = modbus_receive(context_.get(), request);
  if (size < 0) {
    const MutexLock lock(mutex_);
    return master.fd.Close();
  }
  if (size == 0) return;  // of another unit
  server_->RunExclusive([&](RigTime now) {
    const std::string whole(reinterpret_cast<const char*>(request), static_cast<size_t>(size));
    if (wire_ == nullptr) return Answer(master, whole, now);
    for (std::string& passed : wire_->messages().Pass(MessageFaults::Way::kIn, now, whole)) {
      Answer(master, std::move(passed), now);
    }
  });
}

void LampSlave::Answer(Master& master, std::string request, RigTime now) {
  const std::string reply = Reply(request, now);
  const std::vector<std::string> passed =
      wire_ == nullptr ? std::vector<std::string>{reply}
                       : wire_->messages().Pass(MessageFaults::Way::kOut, now, reply);
  const MutexLock lock(mutex_);
  master.unanswered = passed.empty();
  for (const std::string& telegram : passed) Send(master, telegram);
}

std::string LampSlave::Reply(const std::string& request, RigTime now) {
  const auto* const bytes = reinterpret_cast<const uint8_t*>(request.data());
  const int size = static_cast<int>(request.size());
  modbus_set_socket(context_.get(), capture_.get());
  bank_.RequestSeen(now);
  if (bank_.TakeException()) {
    modbus_reply_exception(context_.get(), bytes, MODBUS_EXCEPTION_SLAVE_OR_SERVER_FAILURE);
  } else {
    const int channels = bank_.channel_count();
    const std::unique_ptr<modbus_mapping_t, MappingDeleter> mapping(
        modbus_mapping_new(channels, 0, 0, 2 * channels));
    for (int i = 0; i < channels; ++i) {
      mapping->tab_bits[i] = bank_.Coil(i) ? 1 : 0;
      mapping->tab_input_registers[i] = bank_.FluxPerMille(i, now);
      mapping->tab_input_registers[channels + i] = bank_.HousingTenths(i, now);
    }
    modbus_reply(context_.get(), bytes, size, mapping.get());
    for (int i = 0; i < channels; ++i) {
      const bool on = mapping->tab_bits[i] != 0;
      if (on != bank_.Coil(i)) bank_.Switch(i, on, now);
    }
  }
  char reply[MODBUS_TCP_MAX_ADU_LENGTH];
  const ssize_t length = ::recv(captured_.get(), reply, sizeof(reply), MSG_DONTWAIT);
  return length > 0 ? std::string(reply, static_cast<size_t>(length)) : std::string();
}

void LampSlave::Send(Master& master, const std::string& telegram) {
  // A master that is gone does not want it.
  (void)::send(master.fd.get(), telegram.data(), telegram.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}

void LampSlave::SendLate(const std::string& telegram) {
  const MutexLock lock(mutex_);
  for (const auto& master : masters_) {
    if (!std::exchange(master->unanswered, false)) continue;
    return Send(*master, telegram);
  }
}

}  // namespace mesorig::simulator
