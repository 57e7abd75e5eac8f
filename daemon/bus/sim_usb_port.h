#pragma once
// The simulator's NXT brick over protocol/sim_wire.

#include <memory>

#include "daemon/bus/usb_port.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::daemon {

// Thread-safe. Borrows the link.
class SimUsbPort final : public UsbPort {
 public:
  // NotFound when the simulator has no brick.
  static StatusOr<std::unique_ptr<SimUsbPort>> Open(sim_wire::SimLink& link);
  ~SimUsbPort() override;
  Status Write(std::string_view packet) override;
  void OnPacket(std::function<void(RigTime, std::string packet)> handler) override;

 private:
  SimUsbPort(sim_wire::SimLink& link, uint16_t device) : link_(link), device_(device) {}
  sim_wire::SimLink& link_;
  const uint16_t device_;
};

}  // namespace mesorig::daemon
