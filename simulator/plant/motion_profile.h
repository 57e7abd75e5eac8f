#pragma once
// The motion of one axis towards a target with limited velocity and acceleration: trapezoidal,
// triangular when the way is short, and with a brake before it when the axis moves the wrong way or
// too fast to stop in time. A closed form in time, so that events come at exact instants.
// Any unit of position (counts, radians); seconds. Immutable values, reentrant.

#include <array>

namespace mesorig::plant {

struct MotionLimits {
  double velocity = 0;      // > 0, units a second
  double acceleration = 0;  // > 0, units a second squared; braking as well
};

class MotionProfile {
 public:
  // Stands still at `position`.
  static MotionProfile Standing(double position);
  // From position and velocity at t = 0 to rest at `target`, in the shortest time that the limits
  // permit. A velocity above the limit is first braked down to it. Limits must be positive.
  static MotionProfile To(double position, double velocity, double target, MotionLimits limits);
  // Brakes to rest.
  static MotionProfile Stop(double position, double velocity, double deceleration);

  double Position(double t) const;  // t < 0 gives the start, t >= duration the target exactly
  double Velocity(double t) const;
  double duration_s() const { return duration_; }
  double target() const { return target_; }

 private:
  struct Segment {
    double start_s = 0, position = 0, velocity = 0, acceleration = 0;
  };
  void Add(double seconds, double acceleration);
  const Segment& At(double t) const;

  std::array<Segment, 3> segments_{};
  int count_ = 0;
  double end_position_ = 0, end_velocity_ = 0;
  double duration_ = 0, target_ = 0;
};

}  // namespace mesorig::plant
