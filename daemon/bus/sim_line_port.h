#pragma once
// The simulator's digital lines over protocol/sim_wire.

#include "daemon/bus/line_port.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::daemon {

// Thread-safe. Borrows the link.
class SimLinePort final : public LinePort {
 public:
  // NotFound when the simulator has no lines.
  static StatusOr<std::unique_ptr<SimLinePort>> Open(sim_wire::SimLink& link);
  ~SimLinePort() override;
  StatusOr<bool> Read(int line) override;
  Status Write(int line, bool level) override;
  void OnEdge(std::function<void(int line, bool level, RigTime when)> handler) override;

 private:
  SimLinePort(sim_wire::SimLink& link, uint16_t device) : link_(link), device_(device) {}
  sim_wire::SimLink& link_;
  const uint16_t device_;
};

}  // namespace mesorig::daemon
