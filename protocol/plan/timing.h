#pragma once
// Internal to protocol/plan: how long the rig takes for what a plan says (docs/plans.md, "Time").

#include <span>

#include "protocol/plan/plan.h"
#include "protocol/rig/rig.h"

namespace mesorig {

// All axes start together; when the last is there all rest, for settle_s or the longest time that
// an axis that moved needs by itself. 0 when none moves.
double PositioningSeconds(const Rig& rig, std::span<const double> from_rad,
                          std::span<const double> to_rad, double settle_s);
// Until the light is steady: the slowest of all lamps, as those that go off count too.
double LampSeconds(const Rig& rig);
double ReadoutSeconds(const Rig& rig, std::span<const int> cameras);
// One way from home to every axis' reference, and back to it slowly.
double HomingSeconds(const Rig& rig);

// The motor's speeds are whole hundredths of its full one: the largest that is not above this rate
// of the emitter; 0: the motor does not go so slowly, or so fast.
int SweepPower(const Laser& laser, double rate_rad_s);

// A sweep, from the moment when the rig stands still in the dark. The rig must have a laser.
struct SweepTime {
  double prepare_s = 0;     // the emitter's way to where it takes its run-up; moves overlap it
  double run_s = 0;         // run-up, all frames at the rate that the motor does, laser off again
  double end_tilt_rad = 0;  // where the emitter stands then
};
SweepTime SweepSeconds(const Laser& laser, const Sweep& sweep, double at_tilt_rad);

}  // namespace mesorig
