#pragma once
// Steps and plans for the small rig.

#include <string>
#include <utility>
#include <vector>

#include "protocol/plan/plan.h"
#include "tests/fixtures/small_rig.h"

namespace mesorig::daemon {

using fixtures::SmallLaserRig;
using fixtures::SmallRig;

inline Step PromptStep(std::string text) {
  Step step;
  step.kind = StepKind::kPrompt;
  step.text = std::move(text);
  return step;
}
inline Step MountStep(int mount) {
  Step step;
  step.kind = StepKind::kMount;
  step.sweep.mount = mount;
  return step;
}
inline Step SweepStep(uint32_t index, uint32_t shot, int mount, uint32_t frames) {
  Step step;
  step.kind = StepKind::kSweep;
  step.shot = shot;
  step.exposure_s = 0.02;
  step.cameras = {0, 1};
  step.sweep = {index, mount, -0.05, 0.05, frames, 10, true, {{2, 2, 8, 4}, {0, 0, 16, 8}}};
  return step;
}

inline Step MoveStep(double turntable_deg, double arc_deg) {
  Step step;
  step.kind = StepKind::kMoveAxes;
  step.axis_rad = {RadFromDeg(turntable_deg), RadFromDeg(arc_deg)};
  return step;
}
inline Step LampStep(int lamp) {
  Step step;
  step.kind = StepKind::kLamp;
  step.lamp = lamp;
  return step;
}
inline Step ShotStep(uint32_t shot, double exposure_s, std::vector<int> cameras) {
  Step step;
  step.kind = StepKind::kShot;
  step.shot = shot;
  step.exposure_s = exposure_s;
  step.cameras = std::move(cameras);
  return step;
}

// Two positions, two lamps, three shots, five frames.
inline CompiledPlan SmallPlan(const Rig& rig) {
  CompiledPlan plan;
  plan.name = "small";
  plan.product = {8, 8, 1, 0};
  plan.rig_sha256 = rig.sha256;
  plan.steps = {
      MoveStep(30, -20),         LampStep(0),      ShotStep(0, 0.02, {0, 1}), LampStep(1),
      ShotStep(1, 0.02, {0, 1}), MoveStep(60, 10), ShotStep(2, 0.04, {1}),    LampStep(-1)};
  plan.shots = 3;
  plan.frames = 5;
  plan.seconds = 5;
  return plan;
}

// One shot under a lamp, then two sweeps of five frames at one mount and one at the other.
inline CompiledPlan SmallLaserPlan(const Rig& rig) {
  CompiledPlan plan;
  plan.name = "sweeps";
  plan.rig_sha256 = rig.sha256;
  plan.sample_extent_mm = 20;
  plan.steps = {MoveStep(30, -20),     LampStep(0),           ShotStep(0, 0.02, {0, 1}),
                LampStep(-1),          MountStep(0),          SweepStep(0, 1, 0, 5),
                MoveStep(60, 10),      SweepStep(1, 6, 0, 5), MountStep(1),
                SweepStep(2, 11, 1, 5)};
  plan.shots = 16;
  plan.frames = 32;
  plan.sweeps = 3;
  plan.prompts = 2;
  plan.seconds = 10;
  return plan;
}

}  // namespace mesorig::daemon
