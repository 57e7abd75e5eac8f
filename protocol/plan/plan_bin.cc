#include "protocol/base/bytes.h"
#include "protocol/plan/fits_rig.h"
#include "protocol/plan/plan.h"

namespace mesorig {
namespace {

constexpr uint32_t kMagic = 0x4E4C504D;  // "MPLN"
constexpr uint16_t kVersion = 3;
constexpr uint32_t kMaxSteps = 10'000'000;
constexpr int kMaxProductPx = 16384;

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
  step.purpose = static_cast<Purpose>(in.Get<uint8_t>());
  step.repeat = in.Get<uint32_t>();
  step.settle_s = in.Get<double>();
  step.meter = in.Get<int32_t>();
  const auto rungs = in.Get<uint16_t>();
  for (int i = 0; i < rungs && in.ok(); ++i) step.ladder_s.push_back(in.Get<double>());
  step.text = in.GetString();
  return step;
}

// Numbers that others divide by, allocate by or show.
Status CheckFigures(const CompiledPlan& plan) {
  const Product& product = plan.product;
  const auto sound = [](double value) { return value >= 0 && value < 1e12; };
  if (product.width_px < 1 || product.width_px > kMaxProductPx || product.height_px < 1 ||
      product.height_px > kMaxProductPx || !(product.pitch_mm > 0) || !sound(product.pitch_mm) ||
      !sound(product.h_ref_mm)) {
    return InvalidArgument("plan.bin: a product of {} x {} texels of {} mm at {} mm",
                           product.width_px, product.height_px, product.pitch_mm, product.h_ref_mm);
  }
  for (const double value :
       {plan.sample_extent_mm, plan.sample_thickness_mm, plan.seconds, plan.homing_s,
        plan.lamp_seconds, plan.lower_bound_s, plan.seconds_saved}) {
    if (!sound(value)) return InvalidArgument("plan.bin: a figure of {} in its header", value);
  }
  return OkStatus();
}

}  // namespace

std::string PackPlan(const CompiledPlan& plan) {
  ByteWriter out;
  out.Put(kMagic).Put(kVersion).PutString(plan.name).PutString(plan.sample_name);
  out.PutString(plan.rig_sha256);
  out.Put<int32_t>(plan.product.width_px).Put<int32_t>(plan.product.height_px);
  out.Put(plan.product.pitch_mm).Put(plan.product.h_ref_mm);
  out.PutString(plan.sample_sha256).Put(plan.sample_extent_mm).Put(plan.sample_thickness_mm);
  out.PutString(plan.sample_notes);
  out.Put(plan.shots).Put(plan.frames).Put(plan.sweeps).Put(plan.prompts);
  out.Put(plan.frame_bytes).Put(plan.seconds).Put(plan.homing_s).Put(plan.lamp_seconds);
  out.Put(plan.lower_bound_s).PutString(plan.bottleneck);
  out.Put(plan.frames_blocked).Put(plan.frames_unneeded).Put(plan.seconds_saved);
  out.Put(static_cast<uint32_t>(plan.steps.size()));
  for (const Step& step : plan.steps) {
    out.Put(static_cast<uint8_t>(step.kind)).Put(static_cast<uint8_t>(step.axis_rad.size()));
    for (const double a : step.axis_rad) out.Put(a);
    out.Put<int32_t>(step.lamp).Put(step.shot).Put(step.exposure_s);
    out.Put(static_cast<uint16_t>(step.cameras.size()));
    for (const int camera : step.cameras) out.Put(static_cast<uint16_t>(camera));
    if (step.kind == StepKind::kMount || step.kind == StepKind::kSweep) PutSweep(out, step.sweep);
    out.Put(static_cast<uint8_t>(step.purpose)).Put(step.repeat).Put(step.settle_s);
    out.Put<int32_t>(step.meter).Put(static_cast<uint16_t>(step.ladder_s.size()));
    for (const double rung : step.ladder_s) out.Put(rung);
    out.PutString(step.text);
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
  plan.sample_sha256 = in.GetString();
  plan.sample_extent_mm = in.Get<double>();
  plan.sample_thickness_mm = in.Get<double>();
  plan.sample_notes = in.GetString();
  plan.shots = in.Get<uint32_t>();
  plan.frames = in.Get<uint32_t>();
  plan.sweeps = in.Get<uint32_t>();
  plan.prompts = in.Get<uint32_t>();
  plan.frame_bytes = in.Get<uint64_t>();
  plan.seconds = in.Get<double>();
  plan.homing_s = in.Get<double>();
  plan.lamp_seconds = in.Get<double>();
  plan.lower_bound_s = in.Get<double>();
  plan.bottleneck = in.GetString();
  plan.frames_blocked = in.Get<uint32_t>();
  plan.frames_unneeded = in.Get<uint32_t>();
  plan.seconds_saved = in.Get<double>();
  const auto count = in.Get<uint32_t>();
  if (!in.ok() || count > kMaxSteps) return InvalidArgument("plan.bin: damaged header");
  MESORIG_RETURN_IF_ERROR(CheckFigures(plan));
  if (plan.rig_sha256 != rig.sha256) {
    return InvalidArgument("plan.bin: compiled for another rig ({}, not {})", plan.rig_sha256,
                           rig.sha256);
  }
  StepChecker checker(rig);
  for (uint32_t i = 0; i < count && in.ok(); ++i) {
    plan.steps.push_back(ReadStep(in));
    if (!in.ok()) return InvalidArgument("plan.bin: step {} of {} is cut off", i, count);
    MESORIG_RETURN_IF_ERROR(
        Annotate(checker.Check(plan.steps.back()), fmt::format("plan.bin: step {}", i)));
  }
  if (!in.done()) return InvalidArgument("plan.bin: {} bytes too many", in.remaining());
  return plan;
}

}  // namespace mesorig
