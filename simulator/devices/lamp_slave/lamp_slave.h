#pragma once
// The Modbus TCP end of the lamp bank: one thread, several masters.

#include <memory>
#include <string>
#include <thread>

#include "protocol/base/status.h"
#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/lamp_slave/lamp_bank_model.h"

namespace mesorig::simulator {

class LampSlave {
 public:
  // Listens on a free port of 127.0.0.1.
  static StatusOr<std::unique_ptr<LampSlave>> Listen(LampBankModel& bank, int unit);
  ~LampSlave();
  const std::string& endpoint() const { return endpoint_; }  // "127.0.0.1:PORT"
  // Serves until destruction; `server` is the dispatcher, borrowed.
  void Start(sim_wire::SimServer& server);

 private:
  LampSlave(LampBankModel& bank, int unit, sim_wire::Fd listener, std::string endpoint);
  void Serve();
  void Answer(void* context, const uint8_t* request, int size);

  LampBankModel& bank_;
  const int unit_;
  sim_wire::Fd listener_;
  sim_wire::Fd wake_read_, wake_write_;
  const std::string endpoint_;
  sim_wire::SimServer* server_ = nullptr;
  std::thread thread_;
};

}  // namespace mesorig::simulator
