#include "simulator/devices/lamp_slave/lamp_slave.h"

#include <arpa/inet.h>
#include <modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <vector>

namespace mesorig::simulator {
namespace {

struct ModbusDeleter {
  void operator()(modbus_t* context) const { modbus_free(context); }
};
struct MappingDeleter {
  void operator()(modbus_mapping_t* mapping) const { modbus_mapping_free(mapping); }
};

}  // namespace

StatusOr<std::unique_ptr<LampSlave>> LampSlave::Listen(LampBankModel& bank, int unit) {
  sim_wire::Fd fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof(address);
  if (!fd.valid() ||
      ::bind(fd.get(), reinterpret_cast<sockaddr*>(&address), sizeof(address)) != 0 ||
      ::listen(fd.get(), 4) != 0 ||
      ::getsockname(fd.get(), reinterpret_cast<sockaddr*>(&address), &size) != 0) {
    return Unavailable("lamp bank: cannot listen on 127.0.0.1: {}", strerror(errno));
  }
  return std::unique_ptr<LampSlave>(new LampSlave(
      bank, unit, std::move(fd), fmt::format("127.0.0.1:{}", ntohs(address.sin_port))));
}

LampSlave::LampSlave(LampBankModel& bank, int unit, sim_wire::Fd listener, std::string endpoint)
    : bank_(bank), unit_(unit), listener_(std::move(listener)), endpoint_(std::move(endpoint)) {
  int fds[2];
  if (::pipe(fds) == 0) {
    wake_read_ = sim_wire::Fd(fds[0]);
    wake_write_ = sim_wire::Fd(fds[1]);
  }
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

void LampSlave::Serve() {
  const std::unique_ptr<modbus_t, ModbusDeleter> context(modbus_new_tcp("127.0.0.1", 0));
  modbus_set_slave(context.get(), unit_);
  std::vector<sim_wire::Fd> masters;
  for (;;) {
    std::vector<pollfd> fds = {{wake_read_.get(), POLLIN, 0}, {listener_.get(), POLLIN, 0}};
    for (const auto& master : masters) fds.push_back({master.get(), POLLIN, 0});
    if (::poll(fds.data(), fds.size(), -1) < 0 && errno != EINTR) return;
    if (fds[0].revents != 0) return;
    for (size_t i = 2; i < fds.size(); ++i) {
      if (fds[i].revents == 0) continue;
      uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
      modbus_set_socket(context.get(), masters[i - 2].get());
      const int size = modbus_receive(context.get(), request);
      if (size > 0) {
        Answer(context.get(), request, size);
      } else if (size < 0) {
        masters[i - 2].Close();
      }
    }
    std::erase_if(masters, [](const auto& master) { return !master.valid(); });
    if (fds[1].revents != 0) {
      sim_wire::Fd master(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
      const int on = 1;
      ::setsockopt(master.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
      if (master.valid()) masters.push_back(std::move(master));
    }
  }
}

void LampSlave::Answer(void* context, const uint8_t* request, int size) {
  server_->RunExclusive([&](RigTime now) {
    const int channels = bank_.channel_count();
    const std::unique_ptr<modbus_mapping_t, MappingDeleter> mapping(
        modbus_mapping_new(channels, 0, 0, channels));
    for (int i = 0; i < channels; ++i) {
      mapping->tab_bits[i] = bank_.Coil(i) ? 1 : 0;
      mapping->tab_input_registers[i] = bank_.FluxPerMille(i, now);
    }
    bank_.RequestSeen(now);
    // The reply leaves before the effect is looked at, but inside the same instant.
    modbus_reply(static_cast<modbus_t*>(context), request, size, mapping.get());
    for (int i = 0; i < channels; ++i) {
      const bool on = mapping->tab_bits[i] != 0;
      if (on != bank_.Coil(i)) bank_.Switch(i, on, now);
    }
  });
}

}  // namespace mesorig::simulator
