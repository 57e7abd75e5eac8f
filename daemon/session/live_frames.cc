#include "daemon/session/live_frames.h"

#include <algorithm>
#include <map>

namespace mesorig::daemon {

LiveFrames::LiveFrames(const CompiledPlan& plan, int cameras)
    : shots_(plan.shots),
      has_row_(static_cast<size_t>(cameras), std::vector<bool>(plan.shots)),
      is_live_(has_row_) {
  std::map<std::vector<int>, uint32_t> lists;
  for (const Step& step : plan.steps) {
    if (step.kind != StepKind::kShot && step.kind != StepKind::kSweep) continue;
    const auto [list, is_new] =
        lists.try_emplace(step.cameras, static_cast<uint32_t>(cameras_.size()));
    if (is_new) {
      cameras_.push_back(step.cameras);
      std::sort(cameras_.back().begin(), cameras_.back().end());
    }
    stretches_.push_back(
        {step.shot, step.kind == StepKind::kSweep ? step.sweep.frames : 1, list->second});
  }
  std::stable_sort(stretches_.begin(), stretches_.end(),
                   [](const Stretch& a, const Stretch& b) { return a.first < b.first; });
}

void LiveFrames::Add(int camera, uint32_t shot) {
  if (!Knows(camera, shot)) return;
  has_row_[static_cast<size_t>(camera)][shot] = true;
  is_live_[static_cast<size_t>(camera)][shot] = true;
}

void LiveFrames::Drop(int camera, uint32_t shot) {
  if (Knows(camera, shot)) is_live_[static_cast<size_t>(camera)][shot] = false;
}

bool LiveFrames::HasRow(int camera, uint32_t shot) const {
  return Knows(camera, shot) && has_row_[static_cast<size_t>(camera)][shot];
}

bool LiveFrames::IsLive(int camera, uint32_t shot) const {
  return Knows(camera, shot) && is_live_[static_cast<size_t>(camera)][shot];
}

std::vector<int> LiveFrames::Missing(uint32_t shot) const {
  const auto after =
      std::upper_bound(stretches_.begin(), stretches_.end(), shot,
                       [](uint32_t s, const Stretch& stretch) { return s < stretch.first; });
  std::vector<int> missing;
  if (after == stretches_.begin()) return missing;
  const Stretch& stretch = *std::prev(after);
  if (shot - stretch.first >= stretch.count) return missing;
  for (const int camera : cameras_[stretch.cameras]) {
    if (!IsLive(camera, shot)) missing.push_back(camera);
  }
  return missing;
}

}  // namespace mesorig::daemon
