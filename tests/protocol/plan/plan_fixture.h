#pragma once
// Plan files for the compiler's tests, and what one finds in a compiled plan.

#include <string>
#include <string_view>
#include <vector>

#include "protocol/plan/plan.h"

namespace mesorig::fixtures {

inline const std::string kSource = MESORIG_SOURCE_DIR;

inline Rig DemoRig() { return LoadRig(kSource + "/rigs/demo.toml").value(); }

// Head of a plan file; `sample` are further lines of its [sample].
inline std::string Head(std::string_view sample = "") {
  return fmt::format(
      "name = \"p\"\n[sample]\nname = \"s\"\n{}\n[product]\nwidth_px = 8\nheight_px = 8\n"
      "pitch_mm = 0.5\nh_ref_mm = 4\n",
      sample);
}
// A grid of 2 x 3 positions; `keys` stand in its table.
inline std::string GridOf(std::string_view keys = "exposure_s = 0.02") {
  return fmt::format(
      "[[grid]]\n{}\n[grid.axes.turntable]\nangles_deg = [0, 60]\n"
      "[grid.axes.light_arc]\nangles_deg = [30, 90, 150]\n",
      keys);
}
inline std::string SweepOf(std::string_view keys = "") {
  return fmt::format(
      "[[sweep]]\nfrom_mm = 30\nto_mm = -32\nframes = 32\nframe_rate_hz = 7.5\n"
      "exposure_s = 0.02\nregion_radius_mm = 30\nkeep = \"displacements\"\n{}\n"
      "[sweep.axes.turntable]\nangles_deg = [0, 60]\n[sweep.axes.light_arc]\nangles_deg = [150]\n",
      keys);
}

inline StatusOr<CompiledPlan> Compiled(const std::string& text, const Rig& rig) {
  return CompilePlan(text, "p.toml", rig);
}
inline std::string ErrorOf(const std::string& text) {
  return std::string(Message(Compiled(text, DemoRig()).status()));
}

// A shot with how the rig stands for it.
struct TakenShot {
  std::vector<double> axis_rad;
  int lamp = -1;
  const Step* step = nullptr;
};
inline std::vector<TakenShot> ShotsOf(const CompiledPlan& plan) {
  std::vector<TakenShot> shots;
  TakenShot now;
  for (const Step& step : plan.steps) {
    if (step.kind == StepKind::kMoveAxes) now.axis_rad = step.axis_rad;
    if (step.kind == StepKind::kLamp) now.lamp = step.lamp;
    now.step = &step;
    if (step.kind == StepKind::kShot) shots.push_back(now);
  }
  return shots;
}
inline std::vector<const Step*> StepsOf(const CompiledPlan& plan, StepKind kind) {
  std::vector<const Step*> steps;
  for (const Step& step : plan.steps) {
    if (step.kind == kind) steps.push_back(&step);
  }
  return steps;
}

}  // namespace mesorig::fixtures
