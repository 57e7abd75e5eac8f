// plan.bin with every kind of step: what comes back is what went in, or it is refused.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "tests/protocol/plan/plan_fixture.h"

namespace mesorig {
namespace {

using fixtures::Compiled;
using fixtures::DemoRig;
using fixtures::GridOf;
using fixtures::Head;
using ::testing::HasSubstr;

CompiledPlan Everything(const Rig& rig) {
  return Compiled(Head("thickness_mm = 3\nextent_mm = 40\nnotes = \"n\"") +
                      GridOf("exposure = \"auto\"\nsettle_s = 0.25") +
                      fixtures::SweepOf("mounts = [\"slant\"]") +
                      "[[calibration]]\nkind = \"dark\"\nrepeats = 2\n[[calibration]]\nkind = "
                      "\"ambient\"\n[[prompt]]\nwhen = \"after\"\ntext = \"Done.\"\n",
                  rig)
      .value();
}

TEST(PlanBinV3, KeepsEverything) {
  const Rig rig = DemoRig();
  const CompiledPlan plan = Everything(rig);
  const auto back = UnpackPlan(PackPlan(plan), rig);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(PackPlan(*back), PackPlan(plan));
  EXPECT_EQ(back->sample_sha256, plan.sample_sha256);
  EXPECT_EQ(back->bottleneck, plan.bottleneck);
  ASSERT_EQ(back->steps.size(), plan.steps.size());
  for (size_t i = 0; i < plan.steps.size(); ++i) {
    EXPECT_EQ(back->steps[i].purpose, plan.steps[i].purpose);
    EXPECT_EQ(back->steps[i].repeat, plan.steps[i].repeat);
    EXPECT_EQ(back->steps[i].settle_s, plan.steps[i].settle_s);
    EXPECT_EQ(back->steps[i].meter, plan.steps[i].meter);
    EXPECT_EQ(back->steps[i].ladder_s, plan.steps[i].ladder_s);
    EXPECT_EQ(back->steps[i].text, plan.steps[i].text);
  }
}

// Changes the first step of a kind and tells how the result is refused.
std::string Refusal(StepKind kind, const std::function<void(Step&)>& change) {
  const Rig rig = DemoRig();
  CompiledPlan plan = Everything(rig);
  for (Step& step : plan.steps) {
    if (step.kind != kind) continue;
    change(step);
    break;
  }
  const auto back = UnpackPlan(PackPlan(plan), rig);
  return back.ok() ? "accepted" : std::string(Message(back.status()));
}

TEST(PlanBinV3, RefusesWhatCannotBeRun) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(Refusal(StepKind::kMoveAxes, [&](Step& s) { s.settle_s = nan; }), HasSubstr("settl"));
  EXPECT_THAT(Refusal(StepKind::kMoveAxes, [&](Step& s) { s.axis_rad[0] = nan; }),
              HasSubstr("turntable"));
  EXPECT_THAT(Refusal(StepKind::kMoveAxes, [](Step& s) { s.text = "x"; }), HasSubstr("a text"));
  EXPECT_THAT(Refusal(StepKind::kMeter, [](Step& s) { s.meter = 99; }), HasSubstr("meter 0"));
  EXPECT_THAT(Refusal(StepKind::kMeter, [](Step& s) { s.ladder_s.clear(); }), HasSubstr("0 exp"));
  EXPECT_THAT(Refusal(StepKind::kMeter, [&](Step& s) { s.ladder_s.back() = nan; }),
              HasSubstr("ascend"));
  EXPECT_THAT(Refusal(StepKind::kMeter, [](Step& s) { s.ladder_s.back() = 9; }), HasSubstr("9 s"));
  EXPECT_THAT(Refusal(StepKind::kMeter, [](Step& s) { s.cameras.clear(); }), HasSubstr("cameras"));
  EXPECT_THAT(Refusal(StepKind::kShot, [](Step& s) { s.meter = 0; }), HasSubstr("declares"))
      << "a dark frame, before the meter";
  EXPECT_THAT(Refusal(StepKind::kShot, [](Step& s) { s.purpose = static_cast<Purpose>(9); }),
              HasSubstr("purpose 9"));
  EXPECT_THAT(Refusal(StepKind::kShot, [](Step& s) { s.cameras = {3, 3}; }), HasSubstr("ascend"));
  EXPECT_THAT(Refusal(StepKind::kPrompt, [](Step& s) { s.text = ""; }), HasSubstr("prompt"));
  EXPECT_THAT(Refusal(StepKind::kPrompt, [](Step& s) { s.text = "\x1b[2J"; }), HasSubstr("prompt"));
  EXPECT_THAT(Refusal(StepKind::kLamp, [](Step& s) { s.lamp = 8; }), HasSubstr("lamp 8"));
  EXPECT_THAT(Refusal(StepKind::kSweep, [](Step& s) { s.repeat = 1; }), HasSubstr("repeat"));
}

TEST(PlanBinV3, RefusesFiguresThatAreNone) {
  const Rig rig = DemoRig();
  for (double CompiledPlan::*figure :
       {&CompiledPlan::seconds, &CompiledPlan::lower_bound_s, &CompiledPlan::sample_extent_mm}) {
    CompiledPlan plan = Everything(rig);
    plan.*figure = std::numeric_limits<double>::quiet_NaN();
    EXPECT_FALSE(UnpackPlan(PackPlan(plan), rig).ok());
  }
  CompiledPlan plan = Everything(rig);
  plan.product.width_px = 0;
  EXPECT_FALSE(UnpackPlan(PackPlan(plan), rig).ok());
}

TEST(PlanBinV3, AnotherVersionIsRefused) {
  const Rig rig = DemoRig();
  std::string bytes = PackPlan(Everything(rig));
  bytes[4] = 2;
  EXPECT_THAT(std::string(Message(UnpackPlan(bytes, rig).status())),
              HasSubstr("version 2, this program reads 3"));
}

// Whatever passes can be run: its numbers are finite and in range, its meters are declared.
TEST(PlanBinV3, SurvivesMutation) {
  const Rig rig = DemoRig();
  const std::string whole = PackPlan(Everything(rig));
  std::mt19937 random(7);
  int refused = 0;
  for (int i = 0; i < 4000; ++i) {
    std::string bytes = whole;
    for (int k = 0; k < 2; ++k) bytes[random() % bytes.size()] = static_cast<char>(random());
    if (i % 3 == 0) bytes.resize(random() % bytes.size());
    const auto plan = UnpackPlan(bytes, rig);
    refused += !plan.ok();
    if (!plan.ok()) continue;
    ASSERT_TRUE(std::isfinite(plan->seconds) && std::isfinite(plan->lower_bound_s));
    for (const Step& step : plan->steps) {
      ASSERT_TRUE(std::isfinite(step.settle_s));
      for (const double rung : step.ladder_s) ASSERT_TRUE(std::isfinite(rung));
      for (const int c : step.cameras) ASSERT_LT(c, static_cast<int>(rig.cameras.size()));
    }
  }
  EXPECT_GT(refused, 1500);
}

}  // namespace
}  // namespace mesorig
