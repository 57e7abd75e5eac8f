#include "simulator/plant/lamp_level.h"

#include <algorithm>
#include <cmath>

namespace mesorig::plant {
namespace {
// The rig's time comes in nanoseconds: seconds in double that mean one instant differ by less.
constexpr double kHalfTick = 0.5e-9;
}  // namespace

void LampLevel::Set(double level, double now_s) {
  if (level == target_) return;
  start_ = At(now_s);
  target_ = level;
  changed_s_ = now_s;
}

double LampLevel::At(double t_s) const {
  if (t_s >= SteadyAt() - kHalfTick || !(rise_s_ > 0)) return target_;
  return target_ + (start_ - target_) * std::exp(-std::max(0.0, t_s - changed_s_) / rise_s_);
}

double LampLevel::Mean(double from_s, double to_s) const {
  if (!(to_s > from_s)) return At(from_s);
  // Integral of level - target, which is start - target before the Set, then decays, then is zero.
  double excess = (start_ - target_) * (std::clamp(changed_s_, from_s, to_s) - from_s);
  const double steady = SteadyAt() - kHalfTick;
  const double a = std::clamp(from_s, changed_s_, std::max(changed_s_, steady));
  const double b = std::clamp(to_s, a, std::max(a, steady));
  if (rise_s_ > 0) {
    excess += (start_ - target_) * rise_s_ * std::exp(-(a - changed_s_) / rise_s_) *
              -std::expm1(-(b - a) / rise_s_);
  }
  return target_ + excess / (to_s - from_s);
}

}  // namespace mesorig::plant
