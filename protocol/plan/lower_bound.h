#pragma once
// Internal to protocol/plan: what no order of a plan's shots and sweeps can undercut.

#include <string>

#include "protocol/plan/plan.h"

namespace mesorig {

struct LowerBound {
  double seconds = 0;
  std::string resource;  // the busiest: "exposure", "laser", "axis NAME", "camera NAME"
};
// docs/plans.md, "Lower bound", derives it. Homing and the operator's time are not in it.
LowerBound LowerBoundOf(const CompiledPlan& plan, const Rig& rig);

}  // namespace mesorig
