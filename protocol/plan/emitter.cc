#include "protocol/plan/emitter.h"

#include <algorithm>
#include <utility>

#include "protocol/plan/fits_rig.h"
#include "protocol/plan/timing.h"

namespace mesorig {

Emitter::Emitter(const Rig& rig, CompiledPlan& plan) : rig_(rig), plan_(plan) {
  at_.assign(rig.axes.size(), 0.0);  // home
  wanted_at_ = at_;
}

void Emitter::Stand(const std::vector<double>& axis_rad, double settle_s) {
  wanted_at_ = axis_rad;
  settle_s_ = settle_s;
}

void Emitter::Light(int lamp) { wanted_lamp_ = lamp; }

Step& Emitter::Add(StepKind kind) {
  plan_.steps.emplace_back().kind = kind;
  return plan_.steps.back();
}

void Emitter::Spend(double seconds) {
  plan_.seconds += seconds;
  if (lamp_ >= 0) plan_.lamp_seconds += seconds;
}

double Emitter::GetReady() {
  double seconds = std::exchange(readout_s_, 0.0);
  if (!stands_ || wanted_at_ != at_) {
    seconds = std::max(seconds, PositioningSeconds(rig_, at_, wanted_at_, settle_s_));
    double settle_s = settle_s_;  // the longest of those that move
    for (size_t i = 0; i < at_.size(); ++i) {
      if (at_[i] != wanted_at_[i]) settle_s = std::max(settle_s, rig_.axes[i].settle_s);
    }
    Step& step = Add(StepKind::kMoveAxes);
    step.axis_rad = wanted_at_;
    step.settle_s = settle_s;
    at_ = wanted_at_;
    stands_ = true;
  }
  if (!shines_ || wanted_lamp_ != lamp_) {
    seconds = std::max(seconds, LampSeconds(rig_));
    Add(StepKind::kLamp).lamp = wanted_lamp_;
    lamp_ = wanted_lamp_;
    shines_ = true;
  }
  return seconds;
}

void Emitter::Shoot(const Shot& shot) {
  Spend(GetReady() + shot.exposure_s);
  Step& step = Add(StepKind::kShot);
  step.shot = plan_.shots++;
  step.exposure_s = shot.exposure_s;
  step.cameras = shot.cameras;
  step.purpose = shot.purpose;
  step.meter = shot.meter;
  step.repeat = repeats_[{at_, {lamp_, shot.exposure_s}}]++;
  readout_s_ = ReadoutSeconds(rig_, shot.cameras);
  for (const int camera : shot.cameras) plan_.frame_bytes += rig_.cameras[camera].frame_bytes();
  plan_.frames += static_cast<uint32_t>(shot.cameras.size());
}

int Emitter::Meter(const std::vector<int>& cameras, const std::vector<double>& ladder_s) {
  Spend(GetReady());
  Step& step = Add(StepKind::kMeter);
  step.meter = meters_++;
  step.cameras = cameras;
  step.ladder_s = ladder_s;
  const double readout_s = ReadoutSeconds(rig_, cameras);
  for (const double exposure_s : ladder_s) Spend(exposure_s + readout_s);
  return step.meter;
}

void Emitter::RunSweep(const std::vector<int>& cameras, double exposure_s, Sweep sweep) {
  const SweepTime time = SweepSeconds(*rig_.laser, sweep, tilt_rad_);
  tilt_rad_ = time.end_tilt_rad;
  Spend(std::max(GetReady(), time.prepare_s) + time.run_s);
  sweep.index = plan_.sweeps++;
  plan_.frames += sweep.frames * static_cast<uint32_t>(cameras.size());
  for (size_t k = 0; k < cameras.size(); ++k) {
    const Region& region = sweep.regions[k];
    plan_.frame_bytes += static_cast<uint64_t>(sweep.frames) * static_cast<uint64_t>(region.width) *
                         static_cast<uint64_t>(region.height) *
                         static_cast<uint64_t>(rig_.cameras[cameras[k]].bytes_per_pixel());
  }
  Step& step = Add(StepKind::kSweep);
  step.shot = plan_.shots;
  step.exposure_s = exposure_s;
  step.cameras = cameras;
  plan_.shots += sweep.frames;
  step.sweep = std::move(sweep);
}

void Emitter::ForgetState() {
  Light(-1);
  Spend(std::exchange(readout_s_, 0.0));
  if (std::exchange(lamp_, -1) >= 0) Add(StepKind::kLamp).lamp = -1;
  stands_ = shines_ = false;
}

void Emitter::Mount(int mount) {
  ForgetState();
  ++plan_.prompts;
  Add(StepKind::kMount).sweep.mount = mount;
  tilt_rad_ = 0;
}

Status Emitter::Prompt(const std::string& text) {
  ForgetState();
  const bool goes_on = !plan_.steps.empty() && plan_.steps.back().kind == StepKind::kPrompt;
  if (!goes_on) {
    Add(StepKind::kPrompt).text = text;
    ++plan_.prompts;
    return OkStatus();
  }
  std::string& asked = plan_.steps.back().text;
  asked += " " + text;
  if (asked.size() <= kMaxPromptBytes) return OkStatus();
  return InvalidArgument("plan {}: prompts that follow one another have {} bytes, permitted are {}",
                         plan_.name, asked.size(), kMaxPromptBytes);
}

void Emitter::Finish() {
  Spend(std::exchange(readout_s_, 0.0));
  if (shines_ && lamp_ >= 0) Add(StepKind::kLamp).lamp = -1;
  lamp_ = -1;
}

}  // namespace mesorig
