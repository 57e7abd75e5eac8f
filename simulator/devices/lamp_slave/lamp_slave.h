#pragma once
// The Modbus TCP end of the lamp bank: one thread, several masters.

#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "protocol/base/mutex.h"
#include "protocol/base/status.h"
#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/faults/faulty_device.h"
#include "simulator/devices/lamp_slave/lamp_bank_model.h"

struct _modbus;

namespace mesorig::simulator {

class LampSlave {
 public:
  // Listens on a free port of 127.0.0.1. `wire`: what goes wrong with its telegrams; null: nothing.
  // Unplugged, connections are closed and new ones refused. Borrows both.
  static StatusOr<std::unique_ptr<LampSlave>> Listen(LampBankModel& bank, int unit,
                                                     FaultyDevice* wire = nullptr);
  ~LampSlave();
  const std::string& endpoint() const { return endpoint_; }  // "127.0.0.1:PORT"
  // Serves until destruction; `server` is the dispatcher, borrowed.
  void Start(sim_wire::SimServer& server);

 private:
  struct Master {
    sim_wire::Fd fd;
    bool unanswered = false;  // its last request; a late answer is its
  };
  LampSlave(LampBankModel& bank, int unit, FaultyDevice* wire, int port, sim_wire::Fd listener);
  void Serve();
  void Accept() REQUIRES(mutex_);
  void Receive(Master& master);
  void Answer(Master& master, std::string request, RigTime now);
  // What modbus_reply would have sent.
  std::string Reply(const std::string& request, RigTime now);
  void Send(Master& master, const std::string& telegram) REQUIRES(mutex_);
  void SendLate(const std::string& telegram);
  void CloseAll();
  void SetPlugged(bool plugged);
  void Wake();

  LampBankModel& bank_;
  const int unit_;
  FaultyDevice* const wire_;
  const int port_;
  const std::string endpoint_;
  sim_wire::Fd wake_read_, wake_write_;
  sim_wire::Fd captured_, capture_;  // modbus_reply writes into capture_, we read captured_
  std::unique_ptr<_modbus, void (*)(_modbus*)> context_;
  sim_wire::SimServer* server_ = nullptr;
  // Sockets are polled and read by the thread, and shut down by the dispatcher.
  Mutex mutex_;
  sim_wire::Fd listener_ GUARDED_BY(mutex_);
  std::vector<std::unique_ptr<Master>> masters_ GUARDED_BY(mutex_);
  std::thread thread_;
};

}  // namespace mesorig::simulator
