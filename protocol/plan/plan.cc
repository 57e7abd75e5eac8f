#include "protocol/plan/plan.h"

#include <cmath>

#include "protocol/base/bytes.h"

namespace mesorig {
namespace {

constexpr uint32_t kMagic = 0x4E4C504D;  // "MPLN"
constexpr uint16_t kVersion = 2;
constexpr uint32_t kMaxSteps = 10'000'000;

Sweep ReadSweep(ByteReader& in, int cameras) {
  Sweep sweep;
  sweep.index = in.Get<uint32_t>();
  sweep.mount = in.Get<int32_t>();
  sweep.tilt_from_rad = in.Get<double>();
  sweep.tilt_to_rad = in.Get<double>();
  sweep.frames = in.Get<uint32_t>();
  sweep.frame_rate_hz = in.Get<double>();
  sweep.keep_frames = in.Get<uint8_t>() != 0;
  for (int i = 0; i < cameras && in.ok(); ++i) {
    Region region;
    region.x = in.Get<uint16_t>();
    region.y = in.Get<uint16_t>();
    region.width = in.Get<uint16_t>();
    region.height = in.Get<uint16_t>();
    sweep.regions.push_back(region);
  }
  return sweep;
}

void PutSweep(ByteWriter& out, const Sweep& sweep) {
  out.Put(sweep.index).Put<int32_t>(sweep.mount).Put(sweep.tilt_from_rad).Put(sweep.tilt_to_rad);
  out.Put(sweep.frames).Put(sweep.frame_rate_hz).Put<uint8_t>(sweep.keep_frames ? 1 : 0);
  for (const Region& region : sweep.regions) {
    out.Put(static_cast<uint16_t>(region.x)).Put(static_cast<uint16_t>(region.y));
    out.Put(static_cast<uint16_t>(region.width)).Put(static_cast<uint16_t>(region.height));
  }
}

Step ReadStep(ByteReader& in) {
  Step step;
  step.kind = static_cast<StepKind>(in.Get<uint8_t>());
  const auto axes = in.Get<uint8_t>();
  for (int i = 0; i < axes && in.ok(); ++i) step.axis_rad.push_back(in.Get<double>());
  step.lamp = in.Get<int32_t>();
  step.shot = in.Get<uint32_t>();
  step.exposure_s = in.Get<double>();
  const auto cameras = in.Get<uint16_t>();
  for (int i = 0; i < cameras && in.ok(); ++i) step.cameras.push_back(in.Get<uint16_t>());
  if (step.kind == StepKind::kMount || step.kind == StepKind::kSweep) {
    step.sweep = ReadSweep(in, step.kind == StepKind::kSweep ? cameras : 0);
  }
  return step;
}

bool CamerasFit(const Step& step, const Rig& rig) {
  for (const int camera : step.cameras) {
    if (camera >= static_cast<int>(rig.cameras.size())) return false;
    const Camera& c = rig.cameras[camera];
    if (!(step.exposure_s >= c.min_exposure_s && step.exposure_s <= c.max_exposure_s)) return false;
  }
  return !step.cameras.empty();
}

bool SweepFits(const Step& step, const Rig& rig) {
  const Sweep& sweep = step.sweep;
  for (const double tilt : {sweep.tilt_from_rad, sweep.tilt_to_rad}) {
    if (!(std::abs(tilt) <= rig.laser->max_tilt_rad)) return false;
  }
  if (!(sweep.frame_rate_hz > 0 && sweep.frame_rate_hz <= 1000)) return false;
  if (sweep.frames == 0 || sweep.regions.size() != step.cameras.size()) return false;
  for (size_t k = 0; k < step.cameras.size(); ++k) {
    const Camera& camera = rig.cameras[step.cameras[k]];
    const Region& r = sweep.regions[k];
    if (r.width == 0 || r.height == 0) return false;
    if (r.x + r.width > camera.width || r.y + r.height > camera.height) return false;
    if ((r.x | r.y | r.width | r.height) & 1) return false;
  }
  return true;
}

bool FitsRig(const Step& step, const Rig& rig) {
  switch (step.kind) {
    case StepKind::kMoveAxes:
      if (step.axis_rad.size() != rig.axes.size()) return false;
      for (size_t i = 0; i < rig.axes.size(); ++i) {
        const double a = step.axis_rad[i];
        if (!(a >= rig.axes[i].min_rad && a <= rig.axes[i].max_rad)) return false;
      }
      return true;
    case StepKind::kLamp:
      return step.lamp >= -1 && step.lamp < static_cast<int>(rig.lamps.size());
    case StepKind::kShot:
      return CamerasFit(step, rig);
    case StepKind::kMount:
    case StepKind::kSweep:
      if (!rig.laser || step.sweep.mount < 0) return false;
      if (step.sweep.mount >= static_cast<int>(rig.laser->mounts.size())) return false;
      return step.kind == StepKind::kMount || (CamerasFit(step, rig) && SweepFits(step, rig));
    case StepKind::kPrompt:
    case StepKind::kMeter:
      return false;
  }
  return false;
}

}  // namespace

double MoveSeconds(const Axis& axis, double distance_rad) {
  const double d = std::abs(distance_rad), v = axis.max_velocity_rad_s;
  const double a = axis.acceleration_rad_s2;
  // Too short to reach full speed: a triangle.
  if (d * a < v * v) return 2 * std::sqrt(d / a);
  return d / v + v / a;
}

std::string PackPlan(const CompiledPlan& plan) {
  ByteWriter out;
  out.Put(kMagic).Put(kVersion).PutString(plan.name).PutString(plan.sample_name);
  out.PutString(plan.rig_sha256);
  out.Put<int32_t>(plan.product.width_px).Put<int32_t>(plan.product.height_px);
  out.Put(plan.product.pitch_mm).Put(plan.product.h_ref_mm);
  out.Put(plan.sample_extent_mm);
  out.Put(plan.shots).Put(plan.frames).Put(plan.sweeps).Put(plan.prompts);
  out.Put(plan.frame_bytes).Put(plan.seconds);
  out.Put(plan.lamp_seconds).Put(plan.frames_blocked);
  out.Put(static_cast<uint32_t>(plan.steps.size()));
  for (const Step& step : plan.steps) {
    out.Put(static_cast<uint8_t>(step.kind)).Put(static_cast<uint8_t>(step.axis_rad.size()));
    for (const double a : step.axis_rad) out.Put(a);
    out.Put<int32_t>(step.lamp).Put(step.shot).Put(step.exposure_s);
    out.Put(static_cast<uint16_t>(step.cameras.size()));
    for (const int camera : step.cameras) out.Put(static_cast<uint16_t>(camera));
    if (step.kind == StepKind::kMount || step.kind == StepKind::kSweep) PutSweep(out, step.sweep);
  }
  return out.Take();
}

StatusOr<CompiledPlan> UnpackPlan(std::string_view bytes, const Rig& rig) {
  ByteReader in(bytes);
  if (in.Get<uint32_t>() != kMagic) return InvalidArgument("plan.bin: not a compiled plan");
  if (const auto version = in.Get<uint16_t>(); version != kVersion) {
    return InvalidArgument("plan.bin: version {}, this program reads {}", version, kVersion);
  }
  CompiledPlan plan;
  plan.name = in.GetString();
  plan.sample_name = in.GetString();
  plan.rig_sha256 = in.GetString();
  plan.product.width_px = in.Get<int32_t>();
  plan.product.height_px = in.Get<int32_t>();
  plan.product.pitch_mm = in.Get<double>();
  plan.product.h_ref_mm = in.Get<double>();
  plan.sample_extent_mm = in.Get<double>();
  plan.shots = in.Get<uint32_t>();
  plan.frames = in.Get<uint32_t>();
  plan.sweeps = in.Get<uint32_t>();
  plan.prompts = in.Get<uint32_t>();
  plan.frame_bytes = in.Get<uint64_t>();
  plan.seconds = in.Get<double>();
  plan.lamp_seconds = in.Get<double>();
  plan.frames_blocked = in.Get<uint32_t>();
  const auto count = in.Get<uint32_t>();
  if (!in.ok() || count > kMaxSteps) return InvalidArgument("plan.bin: damaged header");
  if (plan.rig_sha256 != rig.sha256) {
    return InvalidArgument("plan.bin: compiled for another rig ({}, not {})", plan.rig_sha256,
                           rig.sha256);
  }
  for (uint32_t i = 0; i < count && in.ok(); ++i) {
    plan.steps.push_back(ReadStep(in));
    if (!in.ok() || !FitsRig(plan.steps.back(), rig)) {
      return InvalidArgument("plan.bin: step {} of {} is damaged or does not fit the rig", i,
                             count);
    }
  }
  if (!in.done()) return InvalidArgument("plan.bin: {} bytes too many", in.remaining());
  return plan;
}

}  // namespace mesorig
