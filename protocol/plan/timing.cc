#include "protocol/plan/timing.h"

#include <algorithm>
#include <cmath>

namespace mesorig {
namespace {

// Homing on a switch (CiA 402 method 24): past its edge by so much, and back at a tenth.
constexpr double kPastSwitch_rad = 2 * kPi / 360;

// The laser unit on an NXT brick (daemon/drivers/nxt_laser): power of its travels, run-up before
// the first frame, what a command and the reading after it take, and how the laser goes off.
constexpr double kTravelPower = 0.6, kApproachPower = 0.2;
constexpr double kTravelRest_s = 0.3, kBraking_s = 0.18;
constexpr double kRunUp_s = 0.3;
constexpr double kPositionTolerance_rad = 20 * kPi / 180;
constexpr double kStart_s = 0.1;
constexpr double kLaserOff_s = kLaserOneShot_s - 0.05;
constexpr double kCoasting_s = 0.16;  // until it is braked for the next way
constexpr double kApproach_rad = 60 * kPi / 180;

double TravelSeconds(double distance_rad, double speed_rad_s) {
  return std::abs(distance_rad) / speed_rad_s + kTravelRest_s;
}

}  // namespace

double MoveSeconds(const Axis& axis, double distance_rad) {
  const double d = std::abs(distance_rad), v = axis.max_velocity_rad_s;
  const double a = axis.acceleration_rad_s2;
  // Too short to reach full speed: a triangle.
  if (d * a < v * v) return 2 * std::sqrt(d / a);
  return d / v + v / a;
}

double PositioningSeconds(const Rig& rig, std::span<const double> from_rad,
                          std::span<const double> to_rad, double settle_s) {
  double move = 0, rest = 0;
  for (size_t i = 0; i < rig.axes.size(); ++i) {
    if (from_rad[i] == to_rad[i]) continue;
    move = std::max(move, MoveSeconds(rig.axes[i], to_rad[i] - from_rad[i]));
    rest = std::max({rest, settle_s, rig.axes[i].settle_s});
  }
  return move + rest;
}

double LampSeconds(const Rig& rig) {
  double seconds = 0;
  for (const Lamp& lamp : rig.lamps) seconds = std::max(seconds, lamp.settle_s);
  return seconds;
}

double ReadoutSeconds(const Rig& rig, std::span<const int> cameras) {
  double seconds = 0;
  for (const int camera : cameras) seconds = std::max(seconds, rig.cameras[camera].readout_s);
  return seconds;
}

double HomingSeconds(const Rig& rig) {
  double seconds = 0;
  for (Axis axis : rig.axes) {
    axis.max_velocity_rad_s = axis.homing_velocity_rad_s;
    const double search = MoveSeconds(axis, kPastSwitch_rad);
    axis.max_velocity_rad_s = axis.homing_velocity_rad_s / 10;
    seconds = std::max(seconds, search + MoveSeconds(axis, kPastSwitch_rad));
  }
  return seconds;
}

int SweepPower(const Laser& laser, double rate_rad_s) {
  const double power =
      std::floor(std::abs(rate_rad_s) * laser.gear_ratio / laser.full_speed_rad_s * 100 + 1e-9);
  return power >= 1 && power <= 100 ? static_cast<int>(power) : 0;  // (NaN: 0)
}

SweepTime SweepSeconds(const Laser& laser, const Sweep& sweep, double at_tilt_rad) {
  const double steps = std::max(1.0, sweep.frames - 1.0);
  const double step_rad = (sweep.tilt_to_rad - sweep.tilt_from_rad) / steps;
  const int power = SweepPower(laser, step_rad * sweep.frame_rate_hz);
  if (power == 0) return {};  // refused by ReadPlan
  const double motor_rad_s = power / 100.0 * laser.full_speed_rad_s;
  const double rate_rad_s = motor_rad_s / laser.gear_ratio;
  const double run_up_rad = laser.backlash_rad + kPositionTolerance_rad + kRunUp_s * motor_rad_s;
  const double sign = step_rad < 0 ? -1 : 1;
  const double start_rad = sweep.tilt_from_rad * laser.gear_ratio - sign * run_up_rad;
  SweepTime time;
  const double approach_rad = start_rad - sign * kApproach_rad;
  time.prepare_s = kBraking_s +
                   TravelSeconds(approach_rad - at_tilt_rad * laser.gear_ratio,
                                 kTravelPower * laser.full_speed_rad_s) +
                   TravelSeconds(kApproach_rad, kApproachPower * laser.full_speed_rad_s);
  // The last frame's own period is its exposure and readout.
  time.run_s = kStart_s + run_up_rad / motor_rad_s +
               sweep.frames * std::abs(step_rad) / rate_rad_s + kLaserOff_s;
  time.end_tilt_rad = sweep.tilt_to_rad + sign * rate_rad_s * kCoasting_s;
  return time;
}

}  // namespace mesorig
