#pragma once
// One drive with its axis. Position in encoder counts; the world's angle is what the encoder shows
// after homing, so that an axis that was never homed is somewhere else than it says.
//
// The drive steps its motor without looking; the encoder sits on the axis and reads where it really
// is. Steps that the motor lost, or does not make because it is stuck, show as the difference
// between demand and encoder: over the window 0x6065 as a following error (bit 13), below it as a
// target that was reached somewhere else. Switching torque off and on starts anew from where the
// axis stands; so does homing, which seeks its switch.

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "protocol/base/clocks.h"
#include "protocol/rig/rig.h"
#include "protocol/sim_wire/payloads.h"
#include "simulator/devices/cia402_node/object_dictionary.h"
#include "simulator/plant/motion_profile.h"

namespace mesorig::simulator {

class Cia402Node {
 public:
  // power_on_counts: where the axis stands, relative to its home switch, when the rig starts.
  Cia402Node(const Axis& axis, double power_on_counts);

  void Receive(const sim_wire::CanFrame& frame, RigTime now);
  RigTime NextEvent() const;
  void RunEvent(RigTime now);
  void SetPower(bool on, RigTime now);
  // The drive's own supply. Without it nothing is heard or said; when it comes back the drive boots
  // and its encoder counts from 0 where the axis stands: its reference is lost.
  void SetSupply(bool on, RigTime now);
  // The motor does not turn any more, or turns again.
  void SetStuck(bool stuck, RigTime now);
  // In counts, of either sign; nothing while it homes, which seeks its switch.
  void LoseSteps(double counts, RigTime now);
  // The axis slips on the shaft that carries motor and encoder: they do not notice.
  void SlipEncoder(double counts);
  // Too hot: emergency 0x4310 and a fault that no reset clears, until it has cooled.
  void SetHot(bool hot, RigTime now);
  std::vector<sim_wire::CanFrame> TakeOutput() { return std::exchange(output_, {}); }

  // Told when the axis begins to move and when it stands again.
  void OnMotion(std::function<void(bool moves, RigTime)> f) { on_motion_ = std::move(f); }

  // Told when the motor gets torque and when it has none any more.
  void OnTorque(std::function<void(bool on, RigTime)> f) { on_torque_ = std::move(f); }

  // The world's view: angle from the home switch, and whether it is exactly a commanded count.
  double WorldCounts(RigTime t) const;
  bool Moving(RigTime t) const { return !stuck_at_ && Elapsed(t) < motion_.duration_s(); }
  bool torque_on() const { return state_ == State::kOperationEnabled; }
  int node() const { return axis_.can_node; }

 private:
  // Manufacturer's object: where the reference was found by the count before it, counts.
  static constexpr uint16_t kReferenceFound = 0x2001;
  enum class State {
    kSwitchOnDisabled,
    kReadyToSwitchOn,
    kSwitchedOn,
    kOperationEnabled,
    kQuickStopActive,
    kFault,
  };
  void Reset(RigTime now);
  void Nmt(uint8_t command, RigTime now);
  void Sdo(const sim_wire::CanFrame& frame, RigTime now);
  void Controlword(uint16_t word, RigTime now);
  void Transition(uint16_t word, RigTime now);
  void NewSetPoint(RigTime now);
  void StartHoming(RigTime now);
  void NextHomingLeg(RigTime now);
  void QuickStop(RigTime now);
  void Fault(uint16_t emergency_code, RigTime now);
  void StartMotion(double target, double velocity, RigTime now);
  void StandStill(RigTime now);
  void HeartbeatLost(RigTime now);
  void MotionEnded(RigTime now);
  void SetMoves(bool moves, RigTime now);
  bool HasTorque() const;  // also while it brakes
  void NoteTorque(RigTime now);
  // Where the drive thinks that it is, in world counts.
  double DemandCounts(RigTime t) const { return motion_.Position(Elapsed(t)); }
  bool FollowingError(RigTime now) const;
  uint16_t Statusword(RigTime now) const;
  int32_t ActualCounts(RigTime now) const;  // what the encoder shows
  void SendStatus(RigTime now);
  void SendStatusIfChanged(RigTime now);
  double Elapsed(RigTime t) const { return Seconds(t - motion_start_); }
  uint32_t Value(uint16_t index, uint8_t sub = 0) const { return dictionary_.Get(index, sub); }

  const Axis axis_;
  ObjectDictionary dictionary_;
  bool power_ = true, supplied_ = true;
  bool operational_ = false;  // NMT
  State state_ = State::kSwitchOnDisabled;
  uint16_t controlword_ = 0, last_statusword_ = 0;
  plant::MotionProfile motion_ = plant::MotionProfile::Standing(0);
  RigTime motion_start_{};
  bool motion_pending_ = false;  // its end is an event
  bool moves_ = false;
  bool had_torque_ = false, hot_ = false;
  std::function<void(bool, RigTime)> on_motion_, on_torque_;
  double encoder_zero_ = 0;                            // demand at which the encoder shows 0
  std::deque<std::pair<double, double>> homing_legs_;  // target (world counts), velocity
  double homing_velocity_ = 0;                         // of the leg under way
  bool homing_ = false, homing_attained_ = false, homing_error_ = false;
  bool target_reached_ = true, set_point_ack_ = false;
  bool limited_ = false;            // the last set-point was beyond the limits 0x607D
  double lost_ = 0;                 // demand less encoder's side, counts
  double slip_ = 0;                 // world less encoder's side, since it last stood still
  std::optional<double> stuck_at_;  // world counts
  RigTime next_heartbeat_ = kNever, consumer_deadline_ = kNever, next_status_ = kNever;
  std::vector<sim_wire::CanFrame> output_;
};

}  // namespace mesorig::simulator
