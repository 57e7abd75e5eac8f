#pragma once
// The NXT brick as a SimDevice: one telegram a command, one reply an output. README.md says what it
// understands.

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <string_view>
#include <utility>

#include "protocol/rig/rig.h"
#include "protocol/sim_wire/payloads.h"
#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/laser_unit/laser_unit.h"

namespace mesorig::simulator {

class NxtBrick final : public sim_wire::SimDevice {
 public:
  // Rig (with a laser) and unit are borrowed. The laser's motor hangs on Laser::motor_port; the
  // other ports are empty.
  NxtBrick(const Rig& rig, LaserUnit& unit);

  std::string name() const override { return std::string(sim_wire::kNxtDevice); }
  void Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) override;
  StatusOr<std::string> Query(RigTime now, std::string_view payload,
                              sim_wire::Outbox& out) override;
  RigTime NextEvent() const override;
  void RunEvent(RigTime now, sim_wire::Outbox& out) override;
  Status Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) override;

  bool on() const { return on_; }
  // Told when the motor is commanded ("run 20 %", "brake") or reaches its limit.
  void OnMotor(std::function<void(std::string_view what, RigTime)> f) { on_motor_ = std::move(f); }

 private:
  struct Port {
    int8_t power = 0, turn_ratio = 0;
    uint8_t mode = 0, regulation = 0, run_state = 0;
    uint32_t tacho_limit = 0;
    int32_t block_zero = 0, rotation_zero = 0;  // counts at which the counters show 0
  };
  // The reply to a direct command: everything after the opcode, status byte first.
  std::string Answer(RigTime now, uint8_t opcode, std::string_view body);
  std::string AnswerSystem(uint8_t opcode, std::string_view body) const;
  std::string SetOutputState(RigTime now, std::string_view body);
  std::string GetOutputState(RigTime now, std::string_view body) const;
  std::string ResetMotorPosition(RigTime now, std::string_view body);
  void Apply(const Port& port, RigTime now);
  void Stop(RigTime now);
  void SwitchOff(RigTime now);
  int32_t Counts(size_t port, RigTime now) const;
  uint16_t BatteryMv(RigTime now) const;

  const Laser& laser_;
  LaserUnit& unit_;
  std::array<Port, 3> ports_{};
  RigTime limit_at_ = kNever;  // the motor reaches its tacho limit
  bool on_ = true;
  bool stuck_ = false;  // the motor does not turn
  RigTime sleep_at_;
  std::deque<std::pair<RigTime, std::string>> replies_;
  std::function<void(std::string_view, RigTime)> on_motor_;
};

}  // namespace mesorig::simulator
