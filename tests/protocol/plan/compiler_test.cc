#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "protocol/base/file_writer.h"
#include "protocol/plan/plan.h"
#include "protocol/rig/rig_geometry.h"

namespace mesorig {
namespace {

using ::testing::HasSubstr;

const std::string kSource = MESORIG_SOURCE_DIR;

Rig DemoRig() { return LoadRig(kSource + "/rigs/demo.toml").value(); }

constexpr std::string_view kPlan = R"(name = "p"
[sample]
name = "s"
[product]
width_px = 8
height_px = 8
pitch_mm = 0.5
h_ref_mm = 4
[[grid]]
exposure_s = 0.02
[grid.axes.turntable]
angles_deg = [0, 60]
[grid.axes.light_arc]
start_deg = 30
step_deg = 60
count = 3
)";

std::string Replaced(std::string_view from, std::string_view to) {
  std::string text(kPlan);
  text.replace(text.find(from), from.size(), to);
  return text;
}
std::string ErrorOf(const std::string& text) {
  return std::string(Message(CompilePlan(text, "p.toml", DemoRig()).status()));
}

TEST(PlanCompiler, TheDemoIs2304FramesUnderLampsAnd9216OfSweeps) {
  const Rig rig = DemoRig();
  const auto plan = CompilePlanFile(kSource + "/plans/demo.toml", rig);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->shots, 6u * 6 * 8 + 3 * 6 * 64);
  EXPECT_EQ(plan->frames, 2304u + 9216);
  EXPECT_EQ(plan->sweeps, 18u);
  EXPECT_EQ(plan->prompts, 2u);
  EXPECT_EQ(plan->frames_blocked, 0u);
  EXPECT_LT(plan->frame_bytes, 11520u * rig.cameras[0].frame_bytes()) << "regions are smaller";
  EXPECT_GT(plan->seconds, 288 * (0.02 + rig.cameras[0].readout_s));
}

TEST(PlanCompiler, EveryCombinationOnceEachLampAloneAndLightsOffAtTheEnd) {
  const Rig rig = DemoRig();
  const auto plan = CompilePlan(kPlan, "p.toml", rig);
  ASSERT_TRUE(plan.ok()) << plan.status();
  std::set<std::vector<double>> seen;
  std::vector<double> at;
  int lamp = -1;
  uint32_t shot = 0;
  for (const Step& step : plan->steps) {
    if (step.kind == StepKind::kMoveAxes) at = step.axis_rad;
    if (step.kind == StepKind::kLamp) lamp = step.lamp;
    if (step.kind != StepKind::kShot) continue;
    EXPECT_EQ(step.shot, shot++);
    std::vector<double> key = at;
    key.push_back(lamp);
    EXPECT_TRUE(seen.insert(key).second);
    EXPECT_GE(lamp, 0);
  }
  EXPECT_EQ(seen.size(), 2u * 3 * 8);
  EXPECT_EQ(plan->steps.back().kind, StepKind::kLamp);
  EXPECT_EQ(plan->steps.back().lamp, -1);
}

TEST(PlanCompiler, WalksToAndFro) {
  const auto plan = CompilePlan(kPlan, "p.toml", DemoRig());
  ASSERT_TRUE(plan.ok());
  std::vector<double> previous;
  for (const Step& step : plan->steps) {
    if (step.kind != StepKind::kMoveAxes) continue;
    if (!previous.empty()) {
      int moved = 0;
      for (size_t i = 0; i < previous.size(); ++i) moved += previous[i] != step.axis_rad[i];
      EXPECT_EQ(moved, 1) << "one axis at a time, one grid step at a time";
    }
    previous = step.axis_rad;
  }
}

TEST(PlanCompiler, MoveTimesByHand) {
  Axis axis;
  axis.max_velocity_rad_s = 2;
  axis.acceleration_rad_s2 = 4;
  EXPECT_DOUBLE_EQ(MoveSeconds(axis, 0), 0);
  EXPECT_DOUBLE_EQ(MoveSeconds(axis, 0.25), 0.5) << "triangle: 2 sqrt(0.25 / 4)";
  EXPECT_DOUBLE_EQ(MoveSeconds(axis, -1), 1) << "just reaches full speed";
  EXPECT_DOUBLE_EQ(MoveSeconds(axis, 5), 3) << "5/2 + 2/4";
}

// Wang et al. 2005, Sec. 3.2: 26 laser source positions.
TEST(PlanCompiler, ThePapersCaptureHas26LaserSources) {
  const Rig rig = LoadRig(kSource + "/rigs/wang2005.toml").value();
  const auto plan = CompilePlanFile(kSource + "/plans/wang2005.toml", rig);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->prompts, 6u);
  EXPECT_EQ(plan->sweeps, 26u * 12);
  EXPECT_EQ(plan->frames_blocked, 0u);
  const auto arc = static_cast<size_t>(rig.FindAxis("light_arc").value());
  std::set<std::pair<int, double>> sources;
  std::vector<double> at;
  for (const Step& step : plan->steps) {
    if (step.kind == StepKind::kMoveAxes) at = step.axis_rad;
    if (step.kind == StepKind::kSweep) sources.emplace(step.sweep.mount, at[arc]);
  }
  EXPECT_EQ(sources.size(), 26u);
}

std::string WithSweep(std::string_view from = "", std::string_view to = "") {
  std::string sweep = R"([[sweep]]
mounts = ["slant", "zenith"]
from_mm = 30
to_mm = -32
frames = 32
frame_rate_hz = 7.5
exposure_s = 0.02
region_radius_mm = 30
keep = "displacements"
[sweep.axes.turntable]
angles_deg = [0, 60]
[sweep.axes.light_arc]
angles_deg = [150]
)";
  if (!from.empty()) sweep.replace(sweep.find(from), from.size(), to);
  return Replaced("name = \"s\"", "name = \"s\"\nextent_mm = 40") + sweep;
}

// Lamps first and dark before the laser; a prompt before each mount, and its sweeps together.
TEST(PlanCompiler, SweepsComeLastMountByMount) {
  const Rig rig = DemoRig();
  const auto plan = CompilePlan(WithSweep(), "p.toml", rig);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->sweeps, 4u);
  EXPECT_EQ(plan->prompts, 2u);
  std::vector<int> mounts;
  uint32_t shot = 0, sweeps = 0;
  int lamp = -2;
  for (const Step& step : plan->steps) {
    if (step.kind == StepKind::kLamp) lamp = step.lamp;
    if (step.kind == StepKind::kShot) shot = step.shot + 1;
    if (step.kind == StepKind::kMount) mounts.push_back(step.sweep.mount);
    if (step.kind != StepKind::kSweep) continue;
    EXPECT_EQ(lamp, -1);
    EXPECT_EQ(step.shot, shot);
    EXPECT_EQ(step.sweep.index, sweeps++);
    EXPECT_EQ(step.sweep.mount, mounts.back());
    EXPECT_EQ(step.sweep.regions.size(), step.cameras.size());
    EXPECT_FALSE(step.sweep.keep_frames);
    shot += step.sweep.frames;
  }
  EXPECT_EQ(mounts, (std::vector<int>{0, 1})) << "in the rig's order";
  EXPECT_EQ(shot, plan->shots);
}

// At 640 mm and 35 deg the stripe is at 30 mm on the turntable at atan((367.09 - 30) / 524.26) - 35
// deg = -2.260 deg, at -32 mm at atan(399.09 / 524.26) - 35 deg = 2.280 deg.
TEST(PlanCompiler, TiltsByHand) {
  const auto plan = CompilePlan(WithSweep(), "p.toml", DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  const Step& last = plan->steps.back();
  ASSERT_EQ(last.kind, StepKind::kSweep);
  EXPECT_NEAR(DegFromRad(last.sweep.tilt_from_rad), -2.260, 1e-3);
  EXPECT_NEAR(DegFromRad(last.sweep.tilt_to_rad), 2.280, 1e-3);
}

// The camera at the zenith, 800 mm away, focal length 2600 px: a disc of 30 mm is 195 px wide, of
// which the sensor has 192 rows; the top of the relief makes it half a per cent larger.
TEST(PlanCompiler, RegionsHoldTheDisc) {
  const auto plan = CompilePlan(WithSweep(), "p.toml", DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  const Region& above = plan->steps.back().sweep.regions.front();
  EXPECT_EQ(above.y, 0);
  EXPECT_EQ(above.height, 192);
  EXPECT_NEAR(above.x, 128 - 98, 2);
  EXPECT_NEAR(above.width, 197, 3);
  const Region& flat = plan->steps.back().sweep.regions.back();  // theta 75 deg
  EXPECT_NEAR(flat.height, 195 * 0.2588, 18);
  for (const Region& r : plan->steps.back().sweep.regions) {
    EXPECT_EQ((r.x | r.y | r.width | r.height) & 1, 0) << "the Bayer pattern stays";
  }
}

TEST(PlanCompiler, SweepsThatCannotBeAreRefused) {
  EXPECT_THAT(ErrorOf(WithSweep("from_mm = 30", "from_mm = 300")), HasSubstr("from_mm"));
  EXPECT_THAT(ErrorOf(WithSweep("to_mm = -32", "to_mm = 30")), HasSubstr("where the sweep starts"));
  EXPECT_THAT(ErrorOf(WithSweep("frame_rate_hz = 7.5", "frame_rate_hz = 15")),
              HasSubstr("at most 11.53"));
  EXPECT_THAT(ErrorOf(WithSweep("\"slant\", \"zenith\"", "\"attic\"")), HasSubstr("attic"));
  EXPECT_THAT(ErrorOf(WithSweep("keep = \"displacements\"", "keep = \"nothing\"")),
              HasSubstr("keep"));
  EXPECT_THAT(ErrorOf(WithSweep("frames = 32", "frames = 2")), HasSubstr("frames"));
  std::string no_extent = WithSweep();
  no_extent.replace(no_extent.find("extent_mm = 40"), 14, "");
  EXPECT_THAT(ErrorOf(no_extent), HasSubstr("extent_mm"));
}

TEST(PlanBin, SweepsSurviveAndDamageIsRefused) {
  const Rig rig = DemoRig();
  const std::string bytes = PackPlan(CompilePlan(WithSweep(), "p.toml", rig).value());
  const auto back = UnpackPlan(bytes, rig);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(PackPlan(*back), bytes);
  std::mt19937 random(3);
  for (int i = 0; i < 4000; ++i) {
    std::string damaged = bytes;
    if (i % 4 == 0) {
      damaged.resize(random() % bytes.size());
    } else {
      damaged[random() % bytes.size()] = static_cast<char>(random());
    }
    const auto plan = UnpackPlan(damaged, rig);
    if (!plan.ok()) continue;
    for (const Step& step : plan->steps) {  // what passes can be run
      if (step.kind != StepKind::kSweep) continue;
      EXPECT_LE(std::abs(step.sweep.tilt_from_rad), rig.laser->max_tilt_rad);
      EXPECT_EQ(step.sweep.regions.size(), step.cameras.size());
    }
  }
}

TEST(PlanCompiler, RefusesWithFileLineAndValue) {
  EXPECT_THAT(ErrorOf(Replaced("angles_deg = [0, 60]", "angles_deg = [0, 9999]")),
              HasSubstr("axis turntable to 9999 deg"));
  EXPECT_THAT(ErrorOf(Replaced("exposure_s = 0.02", "exposure_s = 99")),
              HasSubstr("p.toml:10:1: `exposure_s` is 99 s"));
  EXPECT_THAT(ErrorOf(Replaced("exposure_s = 0.02", "exposure_s = 0.02\nlamps=['X']")),
              HasSubstr("names \"X\""));
  EXPECT_THAT(ErrorOf(Replaced("[[grid]]", "[[grid]]\nturbo = true")), HasSubstr("p.toml:10:1"));
  EXPECT_THAT(ErrorOf(Replaced("width_px = 8", "width_px = 0")), HasSubstr("p.toml:5:1"));
  EXPECT_THAT(ErrorOf(Replaced("count = 3", "count = 3.5")), HasSubstr("whole number"));
  EXPECT_TRUE(absl::IsNotFound(CompilePlanFile("/nowhere.toml", DemoRig()).status()));
}

TEST(PlanBin, RoundTripsAndIsCanonical) {
  const Rig rig = DemoRig();
  const auto plan = CompilePlan(kPlan, "p.toml", rig).value();
  const std::string bytes = PackPlan(plan);
  EXPECT_EQ(bytes, PackPlan(CompilePlan(kPlan, "p.toml", rig).value()));
  const auto read = UnpackPlan(bytes, rig);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(PackPlan(*read), bytes);
}

TEST(PlanBin, RefusesAnotherRig) {
  Rig rig = DemoRig();
  const std::string bytes = PackPlan(CompilePlan(kPlan, "p.toml", rig).value());
  rig.sha256 = "other";
  EXPECT_THAT(std::string(Message(UnpackPlan(bytes, rig).status())), HasSubstr("another rig"));
}

// Whatever was read is within the rig's limits, or it was refused.
TEST(PlanBin, SurvivesMutation) {
  const Rig rig = DemoRig();
  const std::string whole = PackPlan(CompilePlan(kPlan, "p.toml", rig).value());
  std::mt19937 random(2);
  int refused = 0;
  for (int i = 0; i < 5000; ++i) {
    std::string bytes = whole;
    for (int k = 0; k < 3; ++k) bytes[random() % bytes.size()] = static_cast<char>(random());
    if (random() % 3 == 0) bytes.resize(random() % bytes.size());
    const auto plan = UnpackPlan(bytes, rig);
    refused += !plan.ok();
    if (!plan.ok()) continue;
    for (const Step& step : plan->steps) {
      for (size_t a = 0; a < step.axis_rad.size() && step.kind == StepKind::kMoveAxes; ++a) {
        ASSERT_GE(step.axis_rad[a], rig.axes[a].min_rad);
        ASSERT_LE(step.axis_rad[a], rig.axes[a].max_rad);
      }
    }
  }
  EXPECT_GT(refused, 2000);
}

TEST(PlanText, SurvivesMutation) {
  const Rig rig = DemoRig();
  std::mt19937 random(4);
  int refused = 0;
  for (int i = 0; i < 2000; ++i) {
    std::string text(kPlan);
    for (int k = 0; k < 2; ++k)
      text[random() % text.size()] = static_cast<char>(32 + random() % 95);
    const auto plan = CompilePlan(text, "p.toml", rig);
    refused += !plan.ok();
    ASSERT_TRUE(plan.ok() || !Message(plan.status()).empty());
  }
  EXPECT_GT(refused, 500);
}

}  // namespace
}  // namespace mesorig
