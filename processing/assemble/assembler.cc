#include "processing/assemble/assembler.h"

#include <algorithm>
#include <cmath>

#include "processing/assemble/irradiance.h"
#include "processing/image/demosaic.h"
#include "processing/image/radiance.h"
#include "protocol/base/check.h"
#include "protocol/rig/rig_geometry.h"

namespace mesorig::assemble {
namespace {

// Poses nearer than this share one map: a hundredth of a micrometre in the image.
constexpr double kSameRotation = 1e-7, kSameTranslationMm = 1e-4;

bool SamePose(const RigidTransform& a, const RigidTransform& b) {
  for (size_t k = 0; k < 9; ++k) {
    if (std::abs(a.rotation.m[k] - b.rotation.m[k]) > kSameRotation) return false;
  }
  return Norm(a.translation - b.translation) <= kSameTranslationMm;
}

Status CheckReadingsOf(const char* what, const std::vector<double>& values, size_t expected) {
  if (values.size() != expected) {
    return InvalidArgument("{} {} readings, the rig has {}", values.size(), what, expected);
  }
  for (size_t k = 0; k < values.size(); ++k) {
    if (!std::isfinite(values[k])) return InvalidArgument("{} {} reads {}", what, k, values[k]);
  }
  return OkStatus();
}

}  // namespace

Status CheckReadings(const Rig& rig, const std::vector<double>& axis_rad,
                     const std::vector<double>& lamp_level) {
  MESORIG_RETURN_IF_ERROR(CheckReadingsOf("axis", axis_rad, rig.axes.size()));
  return CheckReadingsOf("lamp", lamp_level, rig.lamps.size());
}

btf::BtfHeader GridOf(const Product& product) {
  btf::BtfHeader grid;
  grid.width = product.width_px;
  grid.height = product.height_px;
  grid.pitch_mm = product.pitch_mm;
  grid.h_ref_mm = product.h_ref_mm;
  return grid;
}

bool Assembler::HasShots(const CompiledPlan& plan) {
  return std::any_of(plan.steps.begin(), plan.steps.end(),
                     [](const Step& step) { return step.kind == StepKind::kShot; });
}

StatusOr<std::unique_ptr<Assembler>> Assembler::Create(Rig rig, CompiledPlan plan,
                                                       const std::filesystem::path& work_file) {
  if (plan.rig_sha256 != rig.sha256) {
    return InvalidArgument("plan {} was compiled for the rig {}, not for {} ({})", plan.name,
                           plan.rig_sha256, rig.name, rig.sha256);
  }
  const btf::BtfHeader grid = GridOf(plan.product);
  size_t frames = 0;
  for (const Step& step : plan.steps) {
    if (step.kind == StepKind::kShot) frames += step.cameras.size();
  }
  MESORIG_ASSIGN_OR_RETURN(WorkFile work,
                           WorkFile::Create(work_file, frames, 3 * grid.texel_count()));
  return std::unique_ptr<Assembler>(
      new Assembler(std::move(rig), std::move(plan), std::move(work)));
}

Assembler::Assembler(Rig rig, CompiledPlan plan, WorkFile work)
    : rig_(std::move(rig)), plan_(std::move(plan)), grid_(GridOf(plan_.product)),
      work_(std::move(work)) {
  shot_steps_.resize(plan_.shots), first_slot_.resize(plan_.shots);
  for (const Step& step : plan_.steps) {
    if (step.kind != StepKind::kShot) continue;
    MESORIG_CHECK(step.shot < shot_steps_.size() && shot_steps_[step.shot] == nullptr);
    shot_steps_[step.shot] = &step;
    first_slot_[step.shot] = slots_.size();
    for (const int camera : step.cameras) {
      Slot slot;
      slot.camera = camera, slot.shot = step.shot;
      slots_.push_back(slot);
    }
  }
  frames_planned_ = static_cast<uint32_t>(slots_.size());
  for (size_t k = 0; k < rig_.cameras.size(); ++k) {
    cameras_.push_back(std::make_unique<CameraState>());
  }
}

StatusOr<size_t> Assembler::SlotFor(const FrameInfo& info) const {
  if (info.camera < 0 || info.camera >= static_cast<int>(rig_.cameras.size())) {
    return InvalidArgument("the rig has {} cameras", rig_.cameras.size());
  }
  if (info.shot >= shot_steps_.size()) {
    return InvalidArgument("the plan has {} shots", shot_steps_.size());
  }
  if (shot_steps_[info.shot] == nullptr) {
    return InvalidArgument("the shot is one of a laser sweep");
  }
  if (info.sequence == 0) return InvalidArgument("a sequence number of 0");
  MESORIG_RETURN_IF_ERROR(CheckReadings(rig_, info.axis_rad, info.lamp_level));
  const std::vector<int>& planned = shot_steps_[info.shot]->cameras;
  const auto found = std::find(planned.begin(), planned.end(), info.camera);
  if (found == planned.end()) return InvalidArgument("the plan does not use this camera there");
  return first_slot_[info.shot] + static_cast<size_t>(found - planned.begin());
}

StatusOr<const RectifyMap*> Assembler::MapFor(CameraState& state, int camera,
                                              const RigidTransform& sample_from_camera) {
  if (!state.map || !SamePose(sample_from_camera, state.sample_from_camera)) {
    state.map.reset();
    MESORIG_ASSIGN_OR_RETURN(
        state.map, RectifyMap::Build(rig_.cameras[static_cast<size_t>(camera)],
                                     sample_from_camera, grid_));
    state.sample_from_camera = sample_from_camera;
  }
  return &*state.map;
}

Status Assembler::Develop(CameraState& state, const FrameInfo& info, std::string_view pixels,
                          std::span<float> values, Slot& slot) {
  const Camera& camera = rig_.cameras[static_cast<size_t>(info.camera)];
  MESORIG_ASSIGN_OR_RETURN(const image::MosaicImage mosaic,
                           image::LinearRadiance(camera, pixels, info.exposure_s));
  const RigidTransform pose = SampleFromCamera(rig_, info.camera, info.axis_rad);
  slot.camera_in_sample = pose.translation;
  MESORIG_ASSIGN_OR_RETURN(const RectifyMap* map, MapFor(state, info.camera, pose));
  MESORIG_ASSIGN_OR_RETURN(const Illumination light,
                           IlluminationAt(rig_, info.axis_rad, info.lamp_level, grid_));
  slot.lamp_in_sample = light.lamp_in_sample;
  MESORIG_ASSIGN_OR_RETURN(const image::RgbImage radiance, image::Demosaic(mosaic));
  slot.clipped_texels = map->Apply(radiance, values);
  for (size_t k = 0; k < values.size(); ++k) {
    values[k] /= light.irradiance[k];
    if (!std::isfinite(values[k])) {
      return FailedPrecondition("an irradiance of {} W m^-2 at texel {}", light.irradiance[k],
                                k / 3);
    }
  }
  return OkStatus();
}

Status Assembler::Add(const FrameInfo& info, std::string_view pixels) {
  const std::string name = fmt::format("camera {}, shot {}", info.camera, info.shot);
  StatusOr<size_t> index = SlotFor(info);
  if (!index.ok()) return Annotate(index.status(), name);
  CameraState& state = *cameras_[static_cast<size_t>(info.camera)];
  MutexLock camera_lock(state.mutex);
  Slot slot;
  {
    MutexLock lock(mutex_);
    slot = slots_[*index];
  }
  if (info.sequence <= slot.sequence) return OkStatus();
  const bool supersedes = slot.sequence != 0;
  slot.refusal.clear();
  const Status status = Develop(state, info, pixels, work_.Slot(*index), slot);
  if (!status.ok() && !absl::IsFailedPrecondition(status)) return Annotate(status, name);
  slot.sequence = info.sequence;
  slot.usable = status.ok();
  if (!status.ok()) {
    slot.refusal = std::string(Message(Annotate(status, name)));
    slot.clipped_texels = 0;
  }
  MutexLock lock(mutex_);
  slots_[*index] = slot;
  if (supersedes) ++superseded_;
  return OkStatus();
}

Tally Assembler::tally() const {
  MutexLock lock(mutex_);
  Tally tally;
  tally.superseded = superseded_;
  for (const Slot& slot : slots_) {
    if (slot.sequence == 0) continue;
    ++tally.frames;
    tally.clipped_texels += slot.clipped_texels;
    if (slot.usable) continue;
    if (tally.refused++ == 0) tally.first_refusal = slot.refusal;
  }
  return tally;
}

}  // namespace mesorig::assemble
