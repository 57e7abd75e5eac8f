#pragma once
// Internal to protocol/plan: makes steps, and counts what they take (docs/plans.md, "Time"). Moves
// and lamps are emitted when a shot, a meter or a sweep needs them to be as they are.

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/plan/plan.h"
#include "protocol/rig/rig.h"

namespace mesorig {

// Borrows rig and plan.
class Emitter {
 public:
  Emitter(const Rig& rig, CompiledPlan& plan);

  // How the rig must stand from now on.
  void Stand(const std::vector<double>& axis_rad, double settle_s);
  void Light(int lamp);  // -1: dark

  struct Shot {
    std::vector<int> cameras;
    double exposure_s = 0;  // of a metered one the longest of its ladder
    Purpose purpose = Purpose::kData;
    int meter = -1;
  };
  void Shoot(const Shot& shot);
  // Returns the meter's number.
  int Meter(const std::vector<int>& cameras, const std::vector<double>& ladder_s);
  void RunSweep(const std::vector<int>& cameras, double exposure_s, Sweep sweep);
  // The operator's part: everything is off meanwhile, and what stands or shines afterwards is not
  // known.
  void Mount(int mount);
  // Prompts that follow one another are one visit. InvalidArgument: too long a text for one.
  Status Prompt(const std::string& text);
  // Lamps off, the last frames delivered.
  void Finish();

  const std::vector<double>& at() const { return at_; }

 private:
  // Emits what is not yet so; returns how long it takes until everything stands, shines and was
  // read out.
  double GetReady();
  void Spend(double seconds);
  void ForgetState();
  Step& Add(StepKind kind);

  const Rig& rig_;
  CompiledPlan& plan_;
  std::vector<double> at_, wanted_at_;  // as the last step says; as Stand asked
  double settle_s_ = 0;
  int lamp_ = -1, wanted_lamp_ = -1;
  bool stands_ = false, shines_ = false;  // at_ and lamp_ were emitted since the last visit
  double readout_s_ = 0;                  // of the shot before
  double tilt_rad_ = 0;                   // where the laser's emitter stands
  int meters_ = 0;
  // How often the same picture was asked for: position, lamp, exposure.
  std::map<std::pair<std::vector<double>, std::pair<int, double>>, uint32_t> repeats_;
};

}  // namespace mesorig
