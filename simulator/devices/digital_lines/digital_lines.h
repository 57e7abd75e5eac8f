#pragma once
// The rig's input lines and the hands that operate them.

#include <map>
#include <string>
#include <vector>

#include "protocol/rig/rig.h"
#include "protocol/sim_wire/payloads.h"
#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/contactor.h"

namespace mesorig::simulator {

class DigitalLinesDevice final : public sim_wire::SimDevice {
 public:
  DigitalLinesDevice(const Lines& lines, Contactor& contactor)
      : lines_(lines), contactor_(contactor) {}

  std::string name() const override { return std::string(sim_wire::kLinesDevice); }
  void Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) override;
  StatusOr<std::string> Query(RigTime now, std::string_view payload,
                              sim_wire::Outbox& out) override;
  RigTime NextEvent() const override { return kNever; }
  void RunEvent(RigTime now, sim_wire::Outbox& out) override;
  Status Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) override;

 private:
  void SetChainLine(int line, bool closed, RigTime now, sim_wire::Outbox& out);
  void SendEdge(int line, bool level, sim_wire::Outbox& out);
  const Lines lines_;
  Contactor& contactor_;
  bool estop_closed_ = true, door_closed_ = true;
};

}  // namespace mesorig::simulator
