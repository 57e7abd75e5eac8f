// Calibration frames, prompts, the sample's record, and what a sample does not need.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "protocol/rig/rig_geometry.h"
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
using fixtures::SweepOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(Calibration, DarkFramesOfEveryExposureThatThePlanUses) {
  const auto plan = Compiled(Head("extent_mm = 40") + GridOf("exposures_s = [0.02, 0.08]") +
                                 SweepOf("cameras = [\"cam1\"]\nmounts = [\"slant\"]") +
                                 "[[calibration]]\nkind = \"dark\"\nrepeats = 2\n",
                             DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  ASSERT_EQ(plan->steps[0].kind, StepKind::kPrompt);
  EXPECT_THAT(plan->steps[0].text, HasSubstr("caps on"));
  size_t i = 0;
  const auto shots = ShotsOf(*plan);
  for (; i < 4; ++i) {
    EXPECT_EQ(shots[i].step->purpose, Purpose::kDark);
    EXPECT_EQ(shots[i].lamp, -1);
    EXPECT_EQ(shots[i].step->repeat, i % 2);
    EXPECT_EQ(shots[i].step->exposure_s, i < 2 ? 0.02 : 0.08);
    EXPECT_EQ(shots[i].step->cameras.size(), 8u);
  }
  EXPECT_EQ(shots[i].step->purpose, Purpose::kData);
  const auto prompts = StepsOf(*plan, StepKind::kPrompt);
  ASSERT_EQ(prompts.size(), 2u);
  EXPECT_LT(prompts[1], shots[4].step);
  EXPECT_THAT(prompts[1]->text, HasSubstr("caps off"));
  EXPECT_EQ(plan->prompts, 3u) << "and one mount";
}

TEST(Calibration, FlatsUnderEachLampThenTheSampleComesBack) {
  const auto plan =
      Compiled(Head() + GridOf("exposure_s = 0.02\nlamps = [\"lamp1\", \"lamp4\"]") +
                   "[[calibration]]\nkind = \"flat\"\nexposures_s = [0.01]\ncameras = [\"cam2\"]\n",
               DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  const auto shots = ShotsOf(*plan);
  EXPECT_EQ(shots[0].lamp, 1);
  EXPECT_EQ(shots[1].lamp, 4);
  for (size_t i = 0; i < 2; ++i) EXPECT_EQ(shots[i].step->purpose, Purpose::kFlat);
  EXPECT_EQ(shots[2].step->purpose, Purpose::kData);
  EXPECT_THAT(StepsOf(*plan, StepKind::kPrompt)[1]->text, HasSubstr("\"s\" back"));
  EXPECT_THAT(
      ErrorOf(Head() + GridOf() + "[[calibration]]\nkind = \"flat\"\nexposures_s = [0.015]\n"),
      HasSubstr("half periods"));
}

TEST(Calibration, AmbientNeedsNobody) {
  const auto plan =
      Compiled(Head() + GridOf() + "[[calibration]]\nkind = \"ambient\"\n", DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->prompts, 0u);
  EXPECT_EQ(ShotsOf(*plan)[0].step->purpose, Purpose::kAmbient);
  EXPECT_EQ(ShotsOf(*plan)[0].lamp, -1);
}

TEST(Calibration, AloneItNeedsItsExposures) {
  const std::string dark = "[[calibration]]\nkind = \"dark\"\n";
  EXPECT_THAT(ErrorOf(Head() + dark), AllOf(HasSubstr("p.toml:10:1"), HasSubstr("exposures_s")));
  const auto plan = Compiled(Head() + dark + "exposures_s = [0.02]\n", DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->frames, 8u);
}

TEST(Prompts, ThatFollowOneAnotherAreOneVisit) {
  const std::string before = "[[prompt]]\nwhen = \"before\"\ntext = ";
  const auto plan =
      Compiled(Head() + GridOf() + before + "\"Clean the plate.\"\n" + before + "\"Level it.\"\n", DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->steps.front().text, "Clean the plate. Level it.");
  EXPECT_EQ(StepsOf(*plan, StepKind::kPrompt).size(), 1u);
  EXPECT_EQ(plan->prompts, 1u);
  const std::string longest = before + '"' + std::string(1500, 'a') + "\"\n";
  EXPECT_THAT(ErrorOf(Head() + GridOf() + longest + longest), HasSubstr("3001 bytes"));
}

TEST(Prompts, BeforeAndAfterEverything) {
  const auto plan = Compiled(Head() + GridOf() +
                                 "[[prompt]]\nwhen = \"after\"\ntext = \"Take it out.\"\n"
                                 "[[prompt]]\nwhen = \"before\"\ntext = \"Clean the plate.\"\n",
                             DemoRig());
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->steps.front().text, "Clean the plate.");
  EXPECT_EQ(plan->steps.back().text, "Take it out.");
  EXPECT_EQ(plan->steps[plan->steps.size() - 2].lamp, -1) << "dark before hands come near";
  EXPECT_THAT(ErrorOf(Head() + GridOf() + "[[prompt]]\nwhen = \"before\"\ntext = \"\"\n"),
              HasSubstr("0 bytes"));
}

std::string WithoutHref(std::string_view sample) {
  std::string text = Head(sample) + GridOf();
  return text.replace(text.find("h_ref_mm = 4\n"), 13, "");
}

TEST(Sample, TheReferencePlaneFollowsFromTheThickness) {
  EXPECT_NEAR(Compiled(WithoutHref("thickness_mm = 3"), DemoRig())->product.h_ref_mm, 3.2, 1e-12);
  EXPECT_NEAR(
      Compiled(WithoutHref("thickness_mm = 3\nclearance_mm = 1"), DemoRig())->product.h_ref_mm, 4,
      1e-12);
  EXPECT_THAT(ErrorOf(WithoutHref("")), HasSubstr("h_ref_mm"));
  EXPECT_THAT(ErrorOf(Head("thickness_mm = 4.5") + GridOf()),
              AllOf(HasSubstr("p.toml:9:1"), HasSubstr("is 4 mm"), HasSubstr("4.5")));
  EXPECT_THAT(ErrorOf(Head("thickness_mm = 3\nclearance_mm = 1") + GridOf()),
              HasSubstr("clearance_mm"));
}

TEST(Sample, TheRecordHasADigestOfItsOwn) {
  const Rig rig = DemoRig();
  const auto plain = Compiled(Head() + GridOf(), rig);
  const auto noted = Compiled(Head("notes = \"damp\"") + GridOf(), rig);
  EXPECT_EQ(plain->sample_sha256,
            Compiled(Head() + GridOf("exposure_s = 0.04"), rig)->sample_sha256);
  EXPECT_NE(plain->sample_sha256, noted->sample_sha256);
  EXPECT_EQ(noted->sample_notes, "damp");
  EXPECT_EQ(plain->sample_sha256.size(), 64u);
}

// Frames at turntable angles 0, 90, 180, 270: a half turn makes two of them superfluous, a quarter
// turn three, as camera and light turn together against the sample.
std::string Turning(std::string_view symmetry) {
  std::string text = Head(symmetry) + GridOf("exposure_s = 0.02\ncameras = [\"cam3\", \"cam5\"]");
  return text.replace(text.find("[0, 60]"), 7, "[0, 90, 180, 270]");
}

TEST(Needs, SymmetriesLeaveOutWhatIsTheSamePairTurned) {
  const Rig rig = DemoRig();
  const auto whole = Compiled(Turning("symmetry = \"none\""), rig);
  ASSERT_TRUE(whole.ok()) << whole.status();
  EXPECT_EQ(whole->frames, 4u * 3 * 8 * 2);
  EXPECT_EQ(whole->frames_unneeded, 0u);
  for (const auto& [symmetry, turns] :
       {std::pair{"half-turn", 2u}, std::pair{"quarter-turn", 4u}, std::pair{"isotropic", 4u}}) {
    const auto plan = Compiled(Turning(fmt::format("symmetry = \"{}\"", symmetry)), rig);
    ASSERT_TRUE(plan.ok()) << plan.status();
    EXPECT_EQ(plan->frames, whole->frames / turns) << symmetry;
    EXPECT_EQ(plan->frames_unneeded, whole->frames - plan->frames);
    EXPECT_NEAR(plan->seconds_saved, whole->seconds - plan->seconds, 1e-9);
    EXPECT_GT(plan->seconds_saved, 0.4 * whole->seconds);
  }
}

TEST(Needs, BracketsStayWhole) {
  const Rig rig = DemoRig();
  std::string text = Turning("symmetry = \"isotropic\"");
  text.replace(text.find("exposure_s = 0.02"), 17, "exposures_s = [0.02, 0.08]\nrepeats = 2");
  const auto plan = Compiled(text, rig);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->frames, 3u * 8 * 2 * 4);
}

TEST(Needs, NothingBeyondTheLimitOfTheta) {
  const Rig rig = DemoRig();
  const auto plan =
      Compiled(Head("max_theta_deg = 45\nextent_mm = 40") + GridOf() + SweepOf(), rig);
  ASSERT_TRUE(plan.ok()) << plan.status();
  // At 4 mm above the turntable the directions are steeper by less than half a degree.
  EXPECT_EQ(ShotsOf(*plan).size(), 6u * 4) << "lamps at 8, 20, 30 and 40 deg";
  for (const Step& step : plan->steps) {
    for (const int c : step.cameras) EXPECT_LE(c, 3) << "cameras at 0, 15, 30 and 40 deg";
  }
  EXPECT_EQ(plan->frames_unneeded, 6u * (64 - 16) + 2 * 2 * 32 * 4);
}

}  // namespace
}  // namespace mesorig
