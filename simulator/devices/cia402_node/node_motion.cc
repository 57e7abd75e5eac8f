// The drive's motion and its axis: set-points, homing, braking, and where the axis really is.

#include "simulator/devices/cia402_node/cia402_node.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace mesorig::simulator {

using std::chrono::milliseconds;

void Cia402Node::NewSetPoint(RigTime now) {
  set_point_ack_ = true;
  double target = dictionary_.GetSigned(0x607A, 0);
  if ((controlword_ & 0x40) != 0) target += DemandCounts(now) - encoder_zero_;  // relative
  const double low = dictionary_.GetSigned(0x607D, 1), high = dictionary_.GetSigned(0x607D, 2);
  const double inside = low < high ? std::clamp(target, low, high) : target;
  limited_ = inside != target;
  StartMotion(inside + encoder_zero_, Value(0x6081), now);
}

void Cia402Node::StartHoming(RigTime now) {
  StandStill(now);  // steps that were lost before do not count: the switch is sought
  homing_ = true;
  homing_attained_ = homing_error_ = false;
  if (Value(0x6098) == 24) {
    // To the switch's edge at search speed, a little past it, and back onto the edge slowly.
    const double edge = 0, past = axis_.counts_per_turn / 360;
    const double side = WorldCounts(now) > edge ? -1 : 1;
    homing_legs_ = {{edge + side * past, Value(0x6099, 1)}, {edge, Value(0x6099, 2)}};
  }
  NextHomingLeg(now);
}

void Cia402Node::NextHomingLeg(RigTime now) {
  if (!homing_legs_.empty()) {
    const auto [target, velocity] = homing_legs_.front();
    homing_legs_.pop_front();
    homing_velocity_ = velocity;
    return StartMotion(target, velocity, now);
  }
  homing_ = false;
  target_reached_ = true;
  homing_error_ = stuck_at_.has_value();  // no switch came
  homing_attained_ = !homing_error_;
  if (homing_error_) return StandStill(now);
  dictionary_.Set(kReferenceFound, 0, static_cast<uint32_t>(ActualCounts(now)));
  encoder_zero_ = WorldCounts(now) - dictionary_.GetSigned(0x607C, 0);
}

void Cia402Node::StartMotion(double target, double velocity, RigTime now) {
  const double t = Elapsed(now);
  motion_ = plant::MotionProfile::To(motion_.Position(t), motion_.Velocity(t), target,
                                     {velocity, static_cast<double>(Value(0x6083))});
  motion_start_ = now;
  motion_pending_ = true;
  target_reached_ = false;
  const uint32_t period = Value(0x1802, 5);
  next_status_ = period == 0 ? kNever : now + milliseconds(period);
  SetMoves(Moving(now), now);
}

void Cia402Node::SetMoves(bool moves, RigTime now) {
  if (moves == moves_) return;
  moves_ = moves;
  if (on_motion_) on_motion_(moves, now);
}

void Cia402Node::StandStill(RigTime now) {
  motion_ = plant::MotionProfile::Standing(std::round(WorldCounts(now)));
  encoder_zero_ += std::exchange(slip_, 0);  // (what the encoder shows stays)
  motion_start_ = now;
  motion_pending_ = homing_ = limited_ = false;
  lost_ = 0;
  homing_legs_.clear();
  next_status_ = kNever;
  SetMoves(false, now);
}

void Cia402Node::QuickStop(RigTime now) {
  const double t = Elapsed(now);
  motion_ = plant::MotionProfile::Stop(motion_.Position(t), motion_.Velocity(t), Value(0x6085));
  motion_start_ = now;
  motion_pending_ = true;
  homing_ = false;
  homing_legs_.clear();
  SetMoves(Moving(now), now);
  state_ = State::kQuickStopActive;
}

void Cia402Node::MotionEnded(RigTime now) {
  motion_pending_ = false;
  motion_ = plant::MotionProfile::Standing(std::round(motion_.target()));
  motion_start_ = now;
  next_status_ = kNever;
  if (homing_) {
    NextHomingLeg(now);
    if (!motion_pending_) SetMoves(false, now);
    return;
  }
  SetMoves(false, now);
  if (state_ == State::kQuickStopActive) {
    state_ = State::kSwitchOnDisabled;
    StandStill(now);
  }
  target_reached_ = !FollowingError(now);
  SendStatus(now);
}

void Cia402Node::SetStuck(bool stuck, RigTime now) {
  if (stuck == stuck_at_.has_value()) return;
  if (stuck) {
    stuck_at_ = std::round(WorldCounts(now));  // on a whole count, as any axis at rest
    return SetMoves(false, now);
  }
  const double world = *std::exchange(stuck_at_, std::nullopt);
  lost_ = DemandCounts(now) - (world - slip_);
  if (homing_) {  // the search goes on from where it stands
    const double target = motion_.target();
    motion_ = plant::MotionProfile::Standing(world);
    lost_ = 0;
    StartMotion(target, homing_velocity_, now);
  }
  SetMoves(Moving(now), now);
  SendStatusIfChanged(now);
}

void Cia402Node::LoseSteps(double counts, RigTime now) {
  if (homing_ || stuck_at_) return;
  lost_ += std::round(counts);
  SendStatus(now);
}

void Cia402Node::SlipEncoder(double counts) {
  slip_ += std::round(counts);
  if (stuck_at_) *stuck_at_ += std::round(counts);
}

double Cia402Node::WorldCounts(RigTime t) const {
  return stuck_at_ ? *stuck_at_ : DemandCounts(t) - lost_ + slip_;
}

bool Cia402Node::FollowingError(RigTime now) const {
  const uint32_t window = Value(0x6065);
  return window != 0xFFFFFFFF && std::abs(DemandCounts(now) - (WorldCounts(now) - slip_)) > window;
}

int32_t Cia402Node::ActualCounts(RigTime now) const {
  return static_cast<int32_t>(std::lround(WorldCounts(now) - slip_ - encoder_zero_));
}

}  // namespace mesorig::simulator
