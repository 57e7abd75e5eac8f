#pragma once
// The light of one lamp, as a share of its full flux, after it was switched: the filament follows
// with a first-order lag, and counts as steady after the settling time, from which on the level is
// the commanded one exactly. (So equal commands give equal pictures, whatever was lit before; the
// jump is exp(-settle/rise) of the step.) Seconds on any one clock. Values, reentrant.

namespace mesorig::plant {

class LampLevel {
 public:
  // rise_s: time constant, 0 follows at once. settle_s: from the command to steady light.
  LampLevel(double rise_s, double settle_s) : rise_s_(rise_s), settle_s_(settle_s) {}

  // Commands arrive in order of time. Setting the level that is commanded already changes nothing.
  void Set(double level, double now_s);
  // Before the last Set the level counts as what it was at that Set.
  double At(double t_s) const;
  double Mean(double from_s, double to_s) const;  // over an exposure
  double commanded() const { return target_; }
  // When the light is steady.
  double SteadyAt() const { return changed_s_ + settle_s_; }

 private:
  double rise_s_, settle_s_;
  double start_ = 0, target_ = 0, changed_s_ = -1e9;
};

}  // namespace mesorig::plant
