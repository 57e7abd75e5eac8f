#include "simulator/plant/geared_motor.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "protocol/base/check.h"

namespace mesorig::plant {
namespace {
constexpr size_t kKeptMoves = 256;
}  // namespace

double GearedMotor::Move::RestAfter() const {
  if (target_speed != 0) return std::numeric_limits<double>::infinity();
  const double ratio = std::abs(speed) / kStandstill_rad_s;
  return ratio > 1 ? time_constant_s * std::log(ratio) : 0;
}

double GearedMotor::Move::Elapsed(RigTime t) const {
  return std::clamp(Seconds(t - start), 0.0, RestAfter());
}

double GearedMotor::Move::AngleAfter(double seconds) const {
  // 1 - exp(-t / tau), without loss for small t.
  const double share = -std::expm1(-seconds / time_constant_s);
  return angle + target_speed * seconds + (speed - target_speed) * time_constant_s * share;
}

double GearedMotor::Move::Speed(RigTime t) const {
  const double seconds = std::max(0.0, Seconds(t - start));
  if (seconds >= RestAfter()) return 0;
  return target_speed + (speed - target_speed) * std::exp(-seconds / time_constant_s);
}

double GearedMotor::Move::Angle(RigTime t, double detent_rad) const {
  const double seconds = Elapsed(t), free = AngleAfter(seconds);
  // A move that begins at rest has been turned already, or a hand placed it.
  const bool stands = speed != 0 && seconds >= RestAfter();
  return stands && detent_rad > 0 ? std::round(free / detent_rad) * detent_rad : free;
}

double GearedMotor::Move::Driven(RigTime t, double play_rad, double detent_rad) const {
  const double seconds = Elapsed(t);
  double side = driven;
  const auto push = [&](double motor) {
    side = std::clamp(side, motor - play_rad / 2, motor + play_rad / 2);
  };
  // The angle is monotonic but for one turning point, where it was moving the other way.
  if (speed * target_speed < 0) {
    const double turn = -time_constant_s * std::log(target_speed / (target_speed - speed));
    if (turn < seconds) push(AngleAfter(turn));
  }
  push(AngleAfter(seconds));
  push(Angle(t, detent_rad));
  return side;
}

const GearedMotor::Move& GearedMotor::At(RigTime t) const {
  size_t i = moves_.size() - 1;
  while (i > 0 && moves_[i].start > t) --i;
  return moves_[i];
}

void GearedMotor::Push(const Move& move) {
  moves_.push_back(move);
  if (moves_.size() > kKeptMoves) moves_.pop_front();
}

void GearedMotor::Drive(double speed_rad_s, double time_constant_s, RigTime now) {
  MESORIG_CHECK(time_constant_s > 0);
  Push({now, Angle(now), Speed(now), Driven(now), speed_rad_s, time_constant_s});
}

void GearedMotor::Place(double angle_rad, RigTime now) {
  Push({now, angle_rad, 0, angle_rad, 0, 1});
}

RigTime GearedMotor::WhenAt(double angle_rad) const {
  const Move& move = moves_.back();
  const double v = move.target_speed, sign = v > 0 ? 1 : -1;
  if (v == 0) return kNever;
  const auto there = [&](RigTime t) { return sign * (move.Angle(t, 0) - angle_rad) >= 0; };
  if (there(move.start)) return move.start;
  // Not there at the start, it gets there once: v t outgrows whatever the run-up takes away.
  const double latest =
      (std::abs(angle_rad - move.angle) + std::abs(move.speed - v) * move.time_constant_s) /
      std::abs(v);
  if (!(latest < 1e8)) return kNever;  // three years; nanoseconds end after 292
  RigTime low = move.start, high = move.start + FromSeconds(latest) + RigTime(1);
  while (high - low > RigTime(1)) {
    const RigTime middle = low + (high - low) / 2;
    (there(middle) ? high : low) = middle;
  }
  return high;
}

}  // namespace mesorig::plant
