#pragma once
// The simulated NXT brick on a USB cable: a server of USB/IP (usbip_server.h), whose packets are
// the simulated device's telegrams.

#include <memory>
#include <string>

#include "protocol/sim_wire/sim_link.h"
#include "simulator/bridge/usbip_server.h"

namespace mesorig::simulator {

class UsbBridge {
 public:
  // Borrows the link. NotFound: the simulated rig has no brick; Unavailable: the port is taken.
  static StatusOr<std::unique_ptr<UsbBridge>> Open(sim_wire::SimLink& link, int port,
                                                   const std::string& serial);
  ~UsbBridge();

 private:
  UsbBridge(sim_wire::SimLink& link, uint16_t device) : link_(link), device_(device) {}
  sim_wire::SimLink& link_;
  const uint16_t device_;
  std::unique_ptr<UsbipServer> server_;
};

}  // namespace mesorig::simulator
