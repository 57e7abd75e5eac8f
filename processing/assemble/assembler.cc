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

bool IsData(const Step& step) {
  return step.kind == StepKind::kShot && step.purpose == Purpose::kData;
}

// More than one exposure, or who knows which.
bool HasBrackets(const CompiledPlan& plan) {
  double first_s = 0;
  for (const Step& step : plan.steps) {
    if (!IsData(step)) continue;
    if (step.meter >= 0) return true;
    if (first_s == 0) first_s = step.exposure_s;
    if (step.exposure_s != first_s) return true;
  }
  return false;
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

bool Assembler::HasData(const CompiledPlan& plan) {
  return std::any_of(plan.steps.begin(), plan.steps.end(), IsData);
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
    if (IsData(step)) frames += step.cameras.size();
  }
  const size_t flags = HasBrackets(plan) ? (grid.texel_count() + 3) / 4 : 0;  // a byte each
  MESORIG_ASSIGN_OR_RETURN(WorkFile work,
                           WorkFile::Create(work_file, std::max<size_t>(frames, 1),
                                            3 * grid.texel_count() + flags));
  MESORIG_ASSIGN_OR_RETURN(BlackLevels black,
                           BlackLevels::Create(rig, plan, work_file.string() + ".black"));
  return std::unique_ptr<Assembler>(
      new Assembler(std::move(rig), std::move(plan), std::move(work), std::move(black)));
}

Assembler::Assembler(Rig rig, CompiledPlan plan, WorkFile work, BlackLevels black)
    : rig_(std::move(rig)), plan_(std::move(plan)), grid_(GridOf(plan_.product)),
      has_brackets_(HasBrackets(plan_)), work_(std::move(work)), black_(std::move(black)) {
  shot_steps_.resize(plan_.shots), first_slot_.resize(plan_.shots);
  size_t data = 0;
  for (const Step& step : plan_.steps) {
    if (step.kind != StepKind::kShot) continue;
    MESORIG_CHECK(step.shot < shot_steps_.size() && shot_steps_[step.shot] == nullptr);
    shot_steps_[step.shot] = &step;
    first_slot_[step.shot] = slots_.size();
    for (const int camera : step.cameras) {
      Slot slot;
      slot.camera = camera, slot.shot = step.shot, slot.purpose = step.purpose;
      if (IsData(step)) slot.work = data++;
      slots_.push_back(slot);
    }
  }
  frames_planned_ = static_cast<uint32_t>(slots_.size());
  for (size_t k = 0; k < rig_.cameras.size(); ++k) {
    cameras_.push_back(std::make_unique<CameraState>());
  }
}

std::span<float> Assembler::Values(size_t work) const {
  return work_.Slot(work).first(3 * grid_.texel_count());
}

std::span<uint8_t> Assembler::Saturated(size_t work) const {
  if (!has_brackets_) return {};
  const std::span<float> flags = work_.Slot(work).subspan(3 * grid_.texel_count());
  return {reinterpret_cast<uint8_t*>(flags.data()), grid_.texel_count()};
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
                          Slot& slot) {
  const Camera& camera = rig_.cameras[static_cast<size_t>(info.camera)];
  slot.exposure_s = info.exposure_s;
  slot.black_version = black_.version(info.camera);
  MESORIG_ASSIGN_OR_RETURN(const image::MosaicImage mosaic,
                           image::LinearRadiance(camera, pixels, info.exposure_s,
                                                 black_.Of(info.camera, info.exposure_s)));
  const RigidTransform pose = SampleFromCamera(rig_, info.camera, info.axis_rad);
  slot.camera_in_sample = pose.translation;
  MESORIG_ASSIGN_OR_RETURN(const RectifyMap* map, MapFor(state, info.camera, pose));
  MESORIG_ASSIGN_OR_RETURN(const Illumination light,
                           IlluminationAt(rig_, info.axis_rad, info.lamp_level, grid_));
  slot.lamp_in_sample = light.lamp_in_sample;
  MESORIG_ASSIGN_OR_RETURN(const image::RgbImage radiance, image::Demosaic(mosaic));
  const std::span<float> values = Values(slot.work);
  slot.clipped_texels = map->Apply(radiance, values, Saturated(slot.work));
  slot.irradiance = {};
  for (size_t k = 0; k < values.size(); ++k) {
    slot.irradiance[k % 3] +=
        static_cast<double>(light.irradiance[k]) / static_cast<double>(grid_.texel_count());
    values[k] /= light.irradiance[k];
    if (!std::isfinite(values[k])) {
      return FailedPrecondition("an irradiance of {} W m^-2 at texel {}", light.irradiance[k],
                                k / 3);
    }
  }
  return OkStatus();
}

Status Assembler::Take(CameraState& state, const FrameInfo& info, std::string_view pixels,
                       Slot& slot) {
  const Camera& camera = rig_.cameras[static_cast<size_t>(info.camera)];
  switch (slot.purpose) {
    case Purpose::kData:
      return Develop(state, info, pixels, slot);
    case Purpose::kAmbient:
    case Purpose::kDark:
      return black_.Add(camera, info.camera, info.shot, pixels);
    case Purpose::kFlat:
      return OkStatus();
  }
  return Internal("a shot of purpose {}", static_cast<int>(slot.purpose));
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
  const bool again = info.sequence == slot.sequence && slot.purpose == Purpose::kData &&
                     slot.black_version != black_.version(info.camera);
  if (info.sequence <= slot.sequence && !again) return OkStatus();
  const bool supersedes = slot.sequence != 0 && !again;
  slot.refusal.clear();
  const Status status = Take(state, info, pixels, slot);
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

bool Assembler::NeedsAgain(int camera) const {
  MutexLock lock(mutex_);
  const uint64_t version = black_.version(camera);
  return std::any_of(slots_.begin(), slots_.end(), [&](const Slot& slot) {
    return slot.camera == camera && slot.purpose == Purpose::kData && slot.sequence != 0 &&
           slot.black_version != version;
  });
}

Tally Assembler::tally() const {
  MutexLock lock(mutex_);
  Tally tally;
  tally.superseded = superseded_;
  for (const Slot& slot : slots_) {
    if (slot.sequence == 0) continue;
    ++tally.frames;
    tally.ambient += slot.purpose == Purpose::kAmbient ? 1 : 0;
    tally.dark += slot.purpose == Purpose::kDark ? 1 : 0;
    tally.flat += slot.purpose == Purpose::kFlat ? 1 : 0;
    tally.clipped_texels += slot.clipped_texels;
    if (slot.usable) continue;
    if (tally.refused++ == 0) tally.first_refusal = slot.refusal;
  }
  return tally;
}

}  // namespace mesorig::assemble
