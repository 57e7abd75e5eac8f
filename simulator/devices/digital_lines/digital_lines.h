#pragma once
// The rig's digital lines and the hands that operate them.

#include <map>
#include <string>
#include <vector>

#include "protocol/rig/rig.h"
#include "protocol/sim_wire/payloads.h"
#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/contactor.h"
#include "simulator/devices/laser_unit/laser_unit.h"

namespace mesorig::simulator {

class DigitalLinesDevice final : public sim_wire::SimDevice {
 public:
  // The laser is borrowed; none in a rig that has none.
  DigitalLinesDevice(const Lines& lines, Contactor& contactor, LaserUnit* laser = nullptr)
      : lines_(lines), contactor_(contactor), laser_(laser), power_said_(contactor.closed()) {}

  std::string name() const override { return std::string(sim_wire::kLinesDevice); }
  void Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) override;
  StatusOr<std::string> Query(RigTime now, std::string_view payload,
                              sim_wire::Outbox& out) override;
  RigTime NextEvent() const override;
  void RunEvent(RigTime now, sim_wire::Outbox& out) override;
  Status Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) override;

 private:
  // What the wire really carries; NotFound: none of the inputs.
  StatusOr<bool> Level(int line, RigTime now) const;
  Status SetStuck(std::string_view input, bool stuck, RigTime now, sim_wire::Outbox& out);
  void SetChainLine(int line, bool closed, RigTime now, sim_wire::Outbox& out);
  void SendLaserEdge(RigTime now, sim_wire::Outbox& out);
  void SendPowerEdge(sim_wire::Outbox& out);
  void SendEdge(int line, bool level, sim_wire::Outbox& out);
  const Lines lines_;
  Contactor& contactor_;
  LaserUnit* const laser_;
  bool estop_closed_ = true, door_closed_ = true;
  bool trigger_ = false;       // the output's level
  bool laser_said_ = false;    // the last edge of laser_on
  bool power_said_;            // of power
  std::map<int, bool> stuck_;  // line to the level that it says
};

}  // namespace mesorig::simulator
