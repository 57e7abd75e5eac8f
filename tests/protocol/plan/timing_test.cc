// Order, estimate and lower bound, by hand and on the paper's capture.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>

#include "tests/fixtures/small_rig.h"
#include "tests/protocol/plan/plan_fixture.h"

namespace mesorig {
namespace {

using fixtures::Compiled;
using fixtures::DemoRig;
using fixtures::GridOf;
using fixtures::Head;
using fixtures::kSource;
using fixtures::ShotsOf;
using fixtures::SmallRig;
using fixtures::StepsOf;

// The small rig's turntable takes 60 deg in 60/90 + 90/180 = 1.1667 s, its arc 10 deg in
// 2 sqrt(10/60) = 0.8165 s; lamps settle in 0.5 s, and readout takes 0.03 s.
constexpr std::string_view kSmall = R"([[grid]]
exposure_s = 0.02
[grid.axes.turntable]
angles_deg = [0, 60]
[grid.axes.arc]
angles_deg = [0, 10]
)";

TEST(Timing, ByHand) {
  const auto plan = Compiled(Head() + std::string(kSmall), SmallRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  ASSERT_EQ(plan->shots, 8u);
  // L0 | L1, arc L1 | L0, turntable L0 | L1, arc L1 | L0: a lamp before each first and second shot.
  EXPECT_NEAR(plan->seconds, 8 * 0.02 + 5 * 0.5 + 2 * 0.81650 + 1.16667 + 0.03, 1e-4);
  EXPECT_NEAR(plan->lamp_seconds, plan->seconds, 1e-9) << "lit all the time";
  // Homing of the arc: a degree past the switch, 2 sqrt(1/60) s, and back at a degree a second.
  EXPECT_NEAR(plan->homing_s, 0.258199 + 1.016667, 1e-4);
}

TEST(Timing, RestCountsAndIsInTheStep) {
  Rig rig = SmallRig();
  rig.axes[1].settle_s = 0.6;
  const auto plan = Compiled(
      Head() + "[[grid]]\nsettle_s = 0.1\n" + std::string(kSmall.substr(kSmall.find("exposure"))),
      rig);
  ASSERT_TRUE(plan.ok()) << plan.status();
  const auto moves = StepsOf(*plan, StepKind::kMoveAxes);
  ASSERT_EQ(moves.size(), 4u);
  EXPECT_EQ(moves[1]->settle_s, 0.1) << "the turntable: 1.17 s and the grid's rest is cheaper";
  EXPECT_EQ(moves[2]->settle_s, 0.6) << "the arc: 0.82 s and 0.6 s is dearer";
}

// What is cheapest is innermost: slow lamps change last.
TEST(Order, SlowLampsAreOutermost) {
  Rig rig = SmallRig();
  for (Lamp& lamp : rig.lamps) lamp.settle_s = 60;
  const auto plan = Compiled(Head() + std::string(kSmall), rig);
  ASSERT_TRUE(plan.ok()) << plan.status();
  const auto shots = ShotsOf(*plan);
  for (size_t i = 0; i < shots.size(); ++i) EXPECT_EQ(shots[i].lamp, i < 4 ? 0 : 1);
}

TEST(Order, TheLampThatShinesStaysLitOverAMove) {
  const auto plan = Compiled(Head() + GridOf(), DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  int lit = -1;
  std::vector<double> at;
  for (const auto& shot : ShotsOf(*plan)) {
    if (!at.empty() && at != shot.axis_rad) {
      EXPECT_EQ(shot.lamp, lit);
    }
    lit = shot.lamp;
    at = shot.axis_rad;
  }
  EXPECT_EQ(StepsOf(*plan, StepKind::kLamp).size(), 6u * 7 + 1 + 1);
}

TEST(LowerBound, ByHand) {
  const auto plan = Compiled(Head() + std::string(kSmall), SmallRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->bottleneck, "exposure");
  // 8 exposures, 3 moves of at least 0.8165 s, 4 lamps; less a readout for the beginning.
  EXPECT_NEAR(plan->lower_bound_s, 8 * 0.02 + 3 * 0.81650 + 4 * 0.5 - 0.03, 1e-4);
}

TEST(LowerBound, ASlowAxisIsTheBottleneck) {
  Rig rig = SmallRig();
  rig.axes[0].max_velocity_rad_s = RadFromDeg(0.1);
  const auto plan = Compiled(Head() + std::string(kSmall), rig);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->bottleneck, "axis turntable");
  EXPECT_NEAR(plan->lower_bound_s, 600, 1);
  EXPECT_LT(plan->seconds, 1.02 * plan->lower_bound_s);
}

TEST(LowerBound, NoPlanIsBelowIt) {
  const Rig rig = DemoRig();
  const std::string dark = "[[calibration]]\nkind = \"dark\"\nrepeats = 3\n";
  for (const std::string& text :
       {Head() + GridOf(), Head() + GridOf("exposures_s = [0.01, 0.5]\nrepeats = 3"),
        Head() + GridOf("exposure = \"auto\"") + dark, Head() + GridOf() + dark,
        Head("extent_mm = 40") + fixtures::SweepOf(),
        Head("extent_mm = 40") + GridOf() + fixtures::SweepOf() + dark}) {
    const auto plan = Compiled(text, rig);
    ASSERT_TRUE(plan.ok()) << plan.status();
    EXPECT_GT(plan->lower_bound_s, 0);
    EXPECT_LE(plan->lower_bound_s, plan->seconds) << text;
  }
}

// Wang et al. 2005: the whole capture, and its lamps alone.
TEST(LowerBound, TheOrderOfThePapersCaptureIsNearIt) {
  const Rig rig = LoadRig(kSource + "/rigs/wang2005.toml").value();
  const auto start = std::chrono::steady_clock::now();
  const auto plan = CompilePlanFile(kSource + "/plans/wang2005.toml", rig);
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->frames, 681024u);
  EXPECT_LT(plan->seconds, 1.05 * plan->lower_bound_s);
  const auto lamps = Compiled(Head() +
                                  "[[grid]]\nexposure_s = 0.02\n[grid.axes.turntable]\nstart_deg = "
                                  "0\nstep_deg = 30\ncount = 12\n[grid.axes.light_arc]\nstart_deg "
                                  "= 15\nstep_deg = 30\ncount = 12\n",
                              rig);
  ASSERT_TRUE(lamps.ok()) << lamps.status();
  EXPECT_EQ(lamps->frames, 9216u);
  EXPECT_LT(lamps->seconds, 1.05 * lamps->lower_bound_s);
  RecordProperty("whole", fmt::format("{} s, bound {} s, compiled in {} s", plan->seconds,
                                      plan->lower_bound_s, seconds.count()));
  std::printf("whole: %.1f s, bound %.1f s (%s), compiled in %.3f s; lamps: %.1f s, bound %.1f s\n",
              plan->seconds, plan->lower_bound_s, plan->bottleneck.c_str(), seconds.count(),
              lamps->seconds, lamps->lower_bound_s);
}

}  // namespace
}  // namespace mesorig
