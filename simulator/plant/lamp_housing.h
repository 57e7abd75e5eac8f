#pragma once
// The temperature of a lamp's housing: it tends to the room's, or to so much above it while the lamp
// burns, with a first-order lag. Seconds on any one clock, degrees Celsius. Values, reentrant.

namespace mesorig::plant {

class LampHousing {
 public:
  static constexpr double kRoom_c = 22, kRise_c = 150, kLag_s = 600;

  // Commands arrive in order of time. level: 0..1 of full power.
  void Set(double level, double now_s);
  void Heat(double celsius, double now_s);  // whatever did that
  double At(double t_s) const;

 private:
  double start_c_ = kRoom_c, level_ = 0, changed_s_ = 0;
};

}  // namespace mesorig::plant
