#include "processing/assemble/black_levels.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "processing/image/radiance.h"

namespace mesorig::assemble {
namespace {

bool SameExposure(double a, double b) { return std::abs(a - b) <= 1e-9 * std::max(a, b); }

}  // namespace

StatusOr<BlackLevels> BlackLevels::Create(const Rig& rig, const CompiledPlan& plan,
                                          const std::filesystem::path& work_file) {
  BlackLevels levels;
  levels.cameras_.resize(rig.cameras.size());
  size_t slots = 0, largest = 0;
  for (size_t c = 0; c < rig.cameras.size(); ++c) {
    const Camera& camera = rig.cameras[c];
    levels.cameras_[c].pixels =
        static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
    largest = std::max(largest, levels.cameras_[c].pixels);
  }
  for (const Step& step : plan.steps) {
    const bool ambient = step.purpose == Purpose::kAmbient;
    if (step.kind != StepKind::kShot || (!ambient && step.purpose != Purpose::kDark)) continue;
    for (const int c : step.cameras) {
      levels.cameras_[static_cast<size_t>(c)].pictures.push_back(
          {step.shot, step.exposure_s, ambient, false, slots++});
    }
  }
  if (slots > 0) {
    MESORIG_ASSIGN_OR_RETURN(WorkFile work, WorkFile::Create(work_file, slots, largest));
    levels.work_.emplace(std::move(work));
  }
  return levels;
}

Status BlackLevels::Add(const Camera& description, int camera, uint32_t shot,
                        std::string_view pixels) {
  CameraState& state = cameras_[static_cast<size_t>(camera)];
  for (Picture& picture : state.pictures) {
    if (picture.shot != shot) continue;
    MESORIG_RETURN_IF_ERROR(
        image::ReadCodes(description, pixels, work_->Slot(picture.slot).first(state.pixels)));
    picture.arrived = true;
    ++state.version;
    return OkStatus();
  }
  return Internal("shot {} is none of the dark", shot);
}

std::span<const float> BlackLevels::Of(int camera, double exposure_s) {
  CameraState& state = cameras_[static_cast<size_t>(camera)];
  if (state.mean_version == state.version && SameExposure(state.mean_exposure_s, exposure_s)) {
    return state.mean;
  }
  state.mean_version = state.version;
  state.mean_exposure_s = exposure_s;
  state.mean.clear();
  const bool ambient = std::any_of(
      state.pictures.begin(), state.pictures.end(),
      [&](const Picture& p) { return p.ambient && SameExposure(p.exposure_s, exposure_s); });
  std::vector<double> sums(state.pixels, 0.0);
  int count = 0;
  for (const Picture& picture : state.pictures) {
    if (!picture.arrived || picture.ambient != ambient) continue;
    if (!SameExposure(picture.exposure_s, exposure_s)) continue;
    ++count;
    const std::span<const float> codes = work_->Slot(picture.slot);
    for (size_t i = 0; i < state.pixels; ++i) sums[i] += static_cast<double>(codes[i]);
  }
  for (size_t i = 0; count > 0 && i < state.pixels; ++i) {
    state.mean.push_back(static_cast<float>(sums[i] / count));
  }
  return state.mean;
}

}  // namespace mesorig::assemble
