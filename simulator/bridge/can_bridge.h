#pragma once
// The simulator's CAN nodes on an interface of the kernel (vcan0): what the interface says they hear,
// what they say it gets. For daemons that use their real driver.

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "protocol/base/status.h"
#include "protocol/base/unique_fd.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::simulator {

class CanBridge {
 public:
  // Borrows the link. NotFound: no such interface;
  // Unavailable: it is no CAN interface, or down.
  static StatusOr<std::unique_ptr<CanBridge>> Open(sim_wire::SimLink& link,
                                                   const std::string& interface);
  ~CanBridge();

 private:
  CanBridge(sim_wire::SimLink& link, uint16_t device, UniqueFd socket);
  void Read();

  sim_wire::SimLink& link_;
  const uint16_t device_;
  const UniqueFd socket_;
  std::atomic<bool> ending_{false};
  std::thread reader_;
};

}  // namespace mesorig::simulator
