// What a plan may ask for in directions and exposures, and what it may not.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "tests/protocol/plan/plan_fixture.h"

namespace mesorig {
namespace {

using fixtures::Compiled;
using fixtures::DemoRig;
using fixtures::ErrorOf;
using fixtures::GridOf;
using fixtures::Head;
using fixtures::ShotsOf;
using fixtures::StepsOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr std::string_view kList = R"([[list]]
exposure_s = 0.02
cameras = ["cam1", "cam3"]
settle_s = 0.5
[[list.position]]
axes_deg = { turntable = 100, light_arc = 90 }
lamps = ["lamp2"]
[[list.position]]
axes_deg = { turntable = 10, light_arc = 90 }
lamps = ["lamp1", "lamp2"]
cameras = ["cam4"]
)";

TEST(Lists, EachPositionHasItsLampsAndCameras) {
  const auto plan = Compiled(Head() + std::string(kList), DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  const auto shots = ShotsOf(*plan);
  ASSERT_EQ(shots.size(), 3u);
  // The nearer one to home first; the lamp that shines stays lit over the move.
  EXPECT_NEAR(shots[0].axis_rad[0], RadFromDeg(10), 1e-12);
  EXPECT_EQ(shots[0].lamp, 1);
  EXPECT_THAT(shots[0].step->cameras, ElementsAre(4));
  EXPECT_EQ(shots[1].lamp, 2);
  EXPECT_NEAR(shots[2].axis_rad[0], RadFromDeg(100), 1e-12);
  EXPECT_THAT(shots[2].step->cameras, ElementsAre(1, 3));
  EXPECT_EQ(StepsOf(*plan, StepKind::kLamp).size(), 3u) << "lamp1, lamp2, off";
  for (const Step* move : StepsOf(*plan, StepKind::kMoveAxes)) EXPECT_EQ(move->settle_s, 0.5);
}

std::string ListWith(std::string_view from, std::string_view to) {
  std::string text = Head() + std::string(kList);
  return text.replace(text.find(from), from.size(), to);
}

TEST(Lists, RefusesWithLineAndValue) {
  EXPECT_THAT(ErrorOf(ListWith("turntable = 100", "turntable = 400")),
              AllOf(HasSubstr("p.toml:15:"), HasSubstr("axis turntable to 400 deg"),
                    HasSubstr("-10 to 370"), HasSubstr("40 deg is the same direction")));
  EXPECT_THAT(ErrorOf(ListWith("turntable = 100, ", "")), HasSubstr("turntable"));
  EXPECT_THAT(ErrorOf(ListWith("\"cam4\"", "\"cam9\"")), HasSubstr("cam9"));
  EXPECT_THAT(ErrorOf(ListWith("settle_s = 0.5", "settle_s = -1")), HasSubstr("settle_s"));
  EXPECT_THAT(ErrorOf(Head() + "[[list]]\nexposure_s = 0.02\n"), HasSubstr("list.position"));
}

// At arc angle 0 the light arc stands before the cameras.
TEST(Lists, APositionThatIsBlockedIsRefusedWithTheSolid) {
  EXPECT_THAT(
      ErrorOf(ListWith("turntable = 100, light_arc = 90", "turntable = 100, light_arc = 0")),
      AllOf(HasSubstr("p.toml:14:1"), HasSubstr("nothing can be seen"), HasSubstr("light arc")));
}

TEST(Grids, CableWrap) {
  std::string text = Head() + GridOf();
  text.replace(text.find("angles_deg = [0, 60]"), 20, "start_deg = 0\nstep_deg = 60\ncount = 8");
  EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr("p.toml:13:1"), HasSubstr("cable wrap"),
                                   HasSubstr("a turn of 420 deg, the axis has 380")));
}

TEST(Grids, AnAngleTwiceIsRefused) {
  std::string text = Head() + GridOf();
  text.replace(text.find("[0, 60]"), 7, "[60, 60]");
  EXPECT_THAT(ErrorOf(text), HasSubstr("60 deg twice"));
}

TEST(Grids, TooManyAreRefusedBeforeTheyAreMade) {
  std::string text = Head() + GridOf();
  text.replace(text.find("angles_deg = [0, 60]"), 20,
               "start_deg = 0\nstep_deg = 1e-3\ncount = 99999");
  EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr("p.toml:10:1"), HasSubstr("299997 positions")));
  EXPECT_THAT(ErrorOf(Head() + GridOf("exposure_s = 0.02\nrepeats = 1001")), HasSubstr("repeats"));
}

// A reference plane above the lamps: none of them is a direction of the sample.
TEST(Grids, BelowTheHorizonIsRefused) {
  std::string text = Head() + GridOf();
  text.replace(text.find("h_ref_mm = 4"), 12, "h_ref_mm = 640");
  EXPECT_THAT(ErrorOf(text),
              AllOf(HasSubstr("p.toml:10:1"), HasSubstr("lamp lamp1"), HasSubstr("horizon")));
}

TEST(Grids, WhereEverythingIsBlockedIsRefused) {
  std::string text =
      Head() + GridOf("exposure_s = 0.02\ncameras = [\"cam6\"]\nlamps = [\"lamp6\"]");
  text.replace(text.find("[30, 90, 150]"), 13, "[0]");
  text.replace(text.find("[0, 60]"), 7, "[0]");
  EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr("p.toml:10:1"), HasSubstr("block every frame")));
}

TEST(Exposures, ABracketIsAShotEach) {
  const auto plan = Compiled(Head() + GridOf("exposures_s = [0.08, 0.02]\nrepeats = 3"), DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  const auto shots = ShotsOf(*plan);
  ASSERT_EQ(shots.size(), 6u * 8 * 2 * 3);
  for (size_t i = 0; i < shots.size(); ++i) {
    EXPECT_EQ(shots[i].step->exposure_s, i / 3 % 2 == 0 ? 0.02 : 0.08);
    EXPECT_EQ(shots[i].step->repeat, i % 3) << "equal shots are told apart";
  }
  EXPECT_EQ(plan->frames, shots.size() * 8);
}

// Two grids that ask for the same picture: the noise must differ, whoever asked.
TEST(Exposures, RepeatsCountOverGridsToo) {
  const std::string lamp = "exposure_s = 0.02\nlamps = [\"lamp1\"]";
  const auto plan = Compiled(Head() + GridOf(lamp) + GridOf(lamp), DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  std::set<std::tuple<std::vector<double>, int, uint32_t>> seen;
  for (const auto& shot : ShotsOf(*plan)) {
    EXPECT_TRUE(seen.insert({shot.axis_rad, shot.lamp, shot.step->repeat}).second);
  }
  EXPECT_EQ(seen.size(), 12u);
}

TEST(Exposures, MeteredOnesAreChosenBeforeTheRun) {
  const auto plan = Compiled(
      Head() + GridOf("exposure = \"auto\"\nladder_s = [0.04, 0.01, 0.02]\nlamps = [\"lamp1\", "
                      "\"lamp5\"]"),
      DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  const auto meters = StepsOf(*plan, StepKind::kMeter);
  ASSERT_EQ(meters.size(), 2u);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(meters[i]->meter, static_cast<int>(i));
    EXPECT_THAT(meters[i]->ladder_s, ElementsAre(0.01, 0.02, 0.04));
    EXPECT_EQ(meters[i]->cameras.size(), 8u);
  }
  const auto shots = ShotsOf(*plan);
  EXPECT_EQ(shots.size(), 12u);
  EXPECT_GT(shots[0].step, meters[1]) << "before the run";
  for (const auto& shot : shots) {
    EXPECT_EQ(shot.step->meter, shot.lamp == 1 ? 0 : 1);
    EXPECT_EQ(shot.step->exposure_s, 0.04);
  }
}

// 0.0001 to 0.5 s at 50 Hz: whole half periods, each twice the one before, and the longest.
TEST(Exposures, ALadderFollowsFromTheLimits) {
  const auto plan = Compiled(Head() + GridOf("exposure = \"auto\""), DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  const auto& ladder = StepsOf(*plan, StepKind::kMeter)[0]->ladder_s;
  const std::vector<double> expected{0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.5};
  ASSERT_EQ(ladder.size(), expected.size());
  for (size_t i = 0; i < ladder.size(); ++i) EXPECT_NEAR(ladder[i], expected[i], 1e-12);
  const auto limited = Compiled(
      Head() + GridOf("exposure = \"auto\"\nexposure_min_s = 0.015\nexposure_max_s = 0.05"),
      DemoRig());
  ASSERT_TRUE(limited.ok()) << limited.status();
  EXPECT_EQ(StepsOf(*limited, StepKind::kMeter)[0]->ladder_s.size(), 3u) << "0.02, 0.04, 0.05";
}

TEST(Exposures, WholeHalfPeriodsOfTheMains) {
  EXPECT_THAT(ErrorOf(Head() + GridOf("exposure_s = 0.025")),
              AllOf(HasSubstr("p.toml:11:1"), HasSubstr("0.025 s"), HasSubstr("0.02 or 0.03 s")));
  EXPECT_THAT(ErrorOf(Head() + GridOf("exposure_s = 0.004")), HasSubstr("the nearest: 0.01 s"));
  EXPECT_THAT(ErrorOf(Head() + GridOf("exposures_s = [0.01, 0.0405]")), HasSubstr("0.04 or 0.05"));
  EXPECT_THAT(ErrorOf(Head() + GridOf("exposure = \"auto\"\nexposure_max_s = 0.009")),
              HasSubstr("half period"));
  // The laser does not flicker.
  std::string sweep = Head("extent_mm = 40") + fixtures::SweepOf();
  sweep.replace(sweep.find("exposure_s = 0.02"), 17, "exposure_s = 0.015");
  EXPECT_TRUE(Compiled(sweep, DemoRig()).ok());
}

TEST(Exposures, OneWayToSayIt) {
  EXPECT_THAT(ErrorOf(Head() + GridOf("exposure_s = 0.02\nexposures_s = [0.02]")),
              HasSubstr("one of exposure_s"));
  EXPECT_THAT(ErrorOf(Head() + GridOf("repeats = 2")), HasSubstr("one of exposure_s"));
  EXPECT_THAT(ErrorOf(Head() + GridOf("exposures_s = [0.02, 0.02]")), HasSubstr("0.02 s twice"));
  EXPECT_THAT(ErrorOf(Head() + GridOf("exposures_s = []")), HasSubstr("0 exposures"));
  EXPECT_THAT(ErrorOf(Head() + GridOf("exposure = \"bright\"")), HasSubstr("auto"));
  EXPECT_THAT(ErrorOf(Head() + GridOf("exposure_s = 0.02\nladder_s = [0.02]")),
              HasSubstr("unknown key `ladder_s`"));
}

TEST(Sweeps, TheMotorMustBeAbleToGoSoSlowly) {
  std::string text = Head("extent_mm = 40") + fixtures::SweepOf();
  text.replace(text.find("frame_rate_hz = 7.5"), 19, "frame_rate_hz = 0.05");
  EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr("frame_rate_hz"), HasSubstr("its motor does 0.0375")));
}

// Every kind of table, damaged: what is accepted can be stored and read back.
TEST(PlanText, EveryTableSurvivesMutation) {
  const Rig rig = DemoRig();
  const std::string whole =
      Head("thickness_mm = 3\nextent_mm = 40\nsymmetry = \"half-turn\"\nmax_theta_deg = 70") +
      GridOf("exposure = \"auto\"\nladder_s = [0.02, 0.04]\nsettle_s = 0.5\nrepeats = 2") +
      std::string(kList) + fixtures::SweepOf("mounts = [\"slant\"]") +
      "[[calibration]]\nkind = \"flat\"\nexposures_s = [0.01]\nlamps = [\"lamp1\"]\n"
      "[[prompt]]\nwhen = \"after\"\ntext = \"Done.\"\n";
  ASSERT_TRUE(Compiled(whole, rig).ok()) << Compiled(whole, rig).status();
  std::mt19937 random(11);
  int refused = 0;
  for (int i = 0; i < 600; ++i) {
    std::string text = whole;
    text[random() % text.size()] = static_cast<char>(i % 2 == 0 ? random() : 48 + random() % 10);
    const auto plan = Compiled(text, rig);
    refused += !plan.ok();
    if (!plan.ok()) {
      ASSERT_FALSE(Message(plan.status()).empty());
      continue;
    }
    const auto back = UnpackPlan(PackPlan(*plan), rig);
    ASSERT_TRUE(back.ok()) << back.status() << "\n" << text;
  }
  EXPECT_GT(refused, 200);
}

}  // namespace
}  // namespace mesorig
