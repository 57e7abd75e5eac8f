#pragma once
// A motor whose speed follows its commanded one with a first-order lag, and a gear with play behind
// it. All closed forms of time, so that any instant can be asked for:
//
//   speed = v + (v0 - v) exp(-t / tau),   angle = a0 + v t + (v0 - v) tau (1 - exp(-t / tau)).
//
// Commanded to stand (v = 0), friction holds it as soon as it is slower than kStandstill_rad_s; its
// cogging then turns it to the nearest detent (so that where it stands does not depend on the last
// bits of how it came). The driven side lies within half the play of the motor's angle and moves only when it is pushed (the
// play operator): what it does depends on the way the motor came. Radians of the motor; times are
// the rig's, of which only differences count. A value, reentrant.

#include <deque>

#include "protocol/base/clocks.h"

namespace mesorig::plant {

inline constexpr double kStandstill_rad_s = 0.0175;  // one degree a second

class GearedMotor {
 public:
  // play_rad: of the motor, from one flank to the other, >= 0. detent_rad: from one detent to the
  // next, angle 0 is one; 0: it has none. Stands at angle 0, the play centred.
  explicit GearedMotor(double play_rad, double detent_rad = 0)
      : play_rad_(play_rad), detent_rad_(detent_rad) {
    moves_.push_back({});
  }

  // From `now` on follows this speed. Calls come in order of time; time_constant_s > 0.
  void Drive(double speed_rad_s, double time_constant_s, RigTime now);
  // A hand turns the motor: it stands at this angle, the play centred.
  void Place(double angle_rad, RigTime now);

  // Before the oldest move that is kept (the last 256): where that one began.
  double Angle(RigTime t) const { return At(t).Angle(t, detent_rad_); }
  double Speed(RigTime t) const { return At(t).Speed(t); }
  double Driven(RigTime t) const { return At(t).Driven(t, play_rad_, detent_rad_); }

  // When the present move reaches this angle, in the direction of its commanded speed; at once when
  // it is there or beyond, kNever when it is to stand.
  RigTime WhenAt(double angle_rad) const;

 private:
  struct Move {
    RigTime start{};
    double angle = 0, speed = 0;  // at the start
    double driven = 0;            // likewise: the driven side, as an angle of the motor
    double target_speed = 0, time_constant_s = 1;
    double Elapsed(RigTime t) const;  // until standstill at most
    double AngleAfter(double seconds) const;
    double Angle(RigTime t, double detent_rad) const;
    double Speed(RigTime t) const;
    double Driven(RigTime t, double play_rad, double detent_rad) const;
    double RestAfter() const;  // seconds until it stands still; infinite when it does not
  };
  const Move& At(RigTime t) const;
  void Push(const Move& move);

  double play_rad_, detent_rad_;
  std::deque<Move> moves_;
};

}  // namespace mesorig::plant
