#include "simulator/plant/motion_profile.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/check.h"

namespace mesorig::plant {

void MotionProfile::Add(double seconds, double acceleration) {
  if (!(seconds > 0)) return;
  segments_[count_++] = {duration_, end_position_, end_velocity_, acceleration};
  end_position_ += (end_velocity_ + 0.5 * acceleration * seconds) * seconds;
  end_velocity_ += acceleration * seconds;
  duration_ += seconds;
}

MotionProfile MotionProfile::Standing(double position) {
  MotionProfile profile;
  profile.end_position_ = profile.target_ = position;
  return profile;
}

MotionProfile MotionProfile::Stop(double position, double velocity, double deceleration) {
  MESORIG_CHECK(deceleration > 0);
  MotionProfile profile = Standing(position);
  profile.end_velocity_ = velocity;
  profile.Add(std::abs(velocity) / deceleration, -std::copysign(deceleration, velocity));
  profile.end_velocity_ = 0;
  profile.target_ = profile.end_position_;
  return profile;
}

MotionProfile MotionProfile::To(double position, double velocity, double target,
                                MotionLimits limits) {
  MESORIG_CHECK(limits.velocity > 0 && limits.acceleration > 0);
  const double a = limits.acceleration;
  MotionProfile profile = Standing(position);
  profile.end_velocity_ = velocity;
  profile.target_ = target;
  // Braking at once ends here; the rest of the way lies on side `s` of it.
  const double standstill = position + velocity * std::abs(velocity) / (2 * a);
  const double s = target >= standstill ? 1.0 : -1.0;
  // v0 -> s v_peak -> 0 covers s (v_peak^2 - v0^2 / 2) / a.
  const double peak =
      std::sqrt(std::max(0.0, a * s * (target - position) + 0.5 * velocity * velocity));
  if (peak <= limits.velocity && s * velocity <= limits.velocity) {  // triangular
    profile.Add((peak - s * velocity) / a, s * a);
    profile.Add(peak / a, -s * a);
  } else {
    const double v = limits.velocity;
    profile.Add(std::abs(s * v - velocity) / a, std::copysign(a, s * v - velocity));
    const double cruise = s * (target - profile.end_position_) - v * v / (2 * a);
    profile.Add(cruise / v, 0);
    profile.Add(v / a, -s * a);
  }
  profile.end_velocity_ = 0;
  return profile;
}

const MotionProfile::Segment& MotionProfile::At(double t) const {
  int i = count_ - 1;
  while (i > 0 && segments_[i].start_s > t) --i;
  return segments_[i];
}

double MotionProfile::Position(double t) const {
  if (t >= duration_) return target_;
  const Segment& segment = At(t);
  const double dt = std::max(0.0, t - segment.start_s);
  return segment.position + (segment.velocity + 0.5 * segment.acceleration * dt) * dt;
}

double MotionProfile::Velocity(double t) const {
  if (t >= duration_) return 0;
  const Segment& segment = At(t);
  return segment.velocity + segment.acceleration * std::max(0.0, t - segment.start_s);
}

}  // namespace mesorig::plant
