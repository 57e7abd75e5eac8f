#pragma once
// The simulator's CAN bus over protocol/sim_wire.

#include "daemon/bus/can_port.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::daemon {

// Thread-safe. Borrows the link.
class SimCanPort final : public CanPort {
 public:
  // NotFound when the simulator has no CAN bus.
  static StatusOr<std::unique_ptr<SimCanPort>> Open(sim_wire::SimLink& link);
  ~SimCanPort() override;
  Status Send(const CanFrame& frame) override;
  void OnFrame(std::function<void(RigTime, const CanFrame&)> handler) override;

 private:
  SimCanPort(sim_wire::SimLink& link, uint16_t device) : link_(link), device_(device) {}
  sim_wire::SimLink& link_;
  const uint16_t device_;
};

}  // namespace mesorig::daemon
