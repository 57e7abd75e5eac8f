#include "daemon/session/planned_sweeps.h"

#include <algorithm>
#include <set>

namespace mesorig::daemon {

PlannedSweeps::PlannedSweeps(const CompiledPlan& plan) {
  for (const Step& step : plan.steps) {
    if (step.kind != StepKind::kSweep) continue;
    sweeps_.push_back(
        {step.sweep.index, step.shot, step.sweep.frames, step.sweep.keep_frames, step.cameras});
  }
  std::stable_sort(sweeps_.begin(), sweeps_.end(),
                   [](const auto& a, const auto& b) { return a.first_shot < b.first_shot; });
}

const PlannedSweep* PlannedSweeps::Find(uint32_t sweep) const {
  const auto found = std::find_if(sweeps_.begin(), sweeps_.end(),
                                  [&](const PlannedSweep& s) { return s.sweep == sweep; });
  return found == sweeps_.end() ? nullptr : &*found;
}

const PlannedSweep* PlannedSweeps::OfShot(uint32_t shot) const {
  const auto after =
      std::upper_bound(sweeps_.begin(), sweeps_.end(), shot,
                       [](uint32_t s, const PlannedSweep& sweep) { return s < sweep.first_shot; });
  if (after == sweeps_.begin()) return nullptr;
  const PlannedSweep& sweep = *std::prev(after);
  return shot - sweep.first_shot < sweep.frames ? &sweep : nullptr;
}

uint32_t PlannedSweeps::SegmentOf(int camera, uint32_t shot) const {
  const PlannedSweep* sweep = OfShot(shot);
  if (sweep == nullptr || sweep->keep_frames) return 0;
  const bool planned =
      std::find(sweep->cameras.begin(), sweep->cameras.end(), camera) != sweep->cameras.end();
  return planned ? sweep->segment() : 0;
}

Status CheckPlan(const CompiledPlan& plan, const Rig& rig) {
  std::set<uint32_t> seen;
  for (const Step& step : plan.steps) {
    const bool sweeps = step.kind == StepKind::kSweep;
    if (step.kind != StepKind::kShot && !sweeps) continue;
    const uint32_t shots = sweeps ? step.sweep.frames : 1;
    const bool cameras_fit = std::all_of(step.cameras.begin(), step.cameras.end(), [&](int c) {
      return c >= 0 && static_cast<size_t>(c) < rig.cameras.size();
    });
    // (Both tested apart: their sum could wrap.)
    if (step.shot >= plan.shots || shots > plan.shots - step.shot || !cameras_fit) {
      return InvalidArgument("plan {}: shot {} does not fit its {} shots or the rig's {} cameras",
                             plan.name, step.shot, plan.shots, rig.cameras.size());
    }
    if (!sweeps) continue;
    const uint32_t index = step.sweep.index;
    if (shots == 0 || index >= plan.sweeps || !seen.insert(index).second ||
        step.sweep.regions.size() != step.cameras.size()) {
      return InvalidArgument(
          "plan {}: sweep {} of shot {} ({} frames, {} cameras, {} regions) is empty, is there "
          "twice or does not fit its {} sweeps",
          plan.name, index, step.shot, shots, step.cameras.size(), step.sweep.regions.size(),
          plan.sweeps);
    }
  }
  return OkStatus();
}

}  // namespace mesorig::daemon
