#pragma once
// Internal to protocol/plan: whether a rig can do what a step of a stored plan says. Whoever runs a
// plan may rely on it.

#include <map>
#include <vector>

#include "protocol/plan/plan.h"

namespace mesorig {

inline constexpr size_t kMaxLadder = 64;  // exposures of a meter
inline constexpr size_t kMaxPromptBytes = 2000;
inline constexpr double kMaxSettle_s = 600;

// Steps are checked one after the other: a shot's meter must have been declared. Borrows the rig.
class StepChecker {
 public:
  explicit StepChecker(const Rig& rig) : rig_(rig) {}
  // InvalidArgument with what does not fit. Fields that the step's kind does not use must have
  // their defaults: equal plans have equal bytes.
  Status Check(const Step& step);

 private:
  Status CheckByKind(const Step& step);
  Status CheckShot(const Step& step) const;
  Status CheckMeter(const Step& step);

  const Rig& rig_;
  std::map<int, std::vector<double>> ladder_of_meter_;
};

}  // namespace mesorig
