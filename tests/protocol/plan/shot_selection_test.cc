#include "protocol/plan/shot_selection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "tests/protocol/plan/plan_fixture.h"

namespace mesorig {
namespace {

using fixtures::DemoRig;
using fixtures::GridOf;
using fixtures::Head;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

// 8 dark frames' shot, 48 shots under lamps, two sweeps of 32.
class Selection : public ::testing::Test {
 protected:
  const Rig rig = DemoRig();
  const CompiledPlan plan = fixtures::Compiled(Head("extent_mm = 40") + GridOf() +
                                                   fixtures::SweepOf("mounts = [\"slant\"]") +
                                                   "[[calibration]]\nkind = \"dark\"\n",
                                               rig)
                                .value();
  ShotSelection Select(std::string_view text) {
    const auto selection = ParseShotSelection(text, plan, rig);
    EXPECT_TRUE(selection.ok()) << selection.status();
    return selection.ok() ? *selection : ShotSelection{};
  }
  std::string ErrorOf(std::string_view text) {
    return std::string(Message(ParseShotSelection(text, plan, rig).status()));
  }
};

TEST_F(Selection, ShotsAndCameras) {
  const ShotSelection some = Select("shots 10-12, shot 20, camera cam3, camera \"cam1\"");
  ASSERT_EQ(some.size(), 4u);
  EXPECT_EQ(some.back().shot, 20u);
  for (const SelectedShot& shot : some) EXPECT_THAT(shot.cameras, ElementsAre(1, 3));
  EXPECT_EQ(Select("camera cam0").size(), plan.shots);
  EXPECT_EQ(Select("shots 0 - 3").size(), 4u);
}

TEST_F(Selection, LampsSweepsAndPurposes) {
  EXPECT_EQ(Select("lamp lamp2").size(), 6u);
  EXPECT_EQ(Select("sweep 1").size(), 32u);
  EXPECT_EQ(Select("sweep 1").front().shot, 49u + 32);
  ASSERT_EQ(Select("dark").size(), 1u);
  EXPECT_EQ(Select("dark").front().cameras.size(), 8u);
  EXPECT_EQ(Select("data").size(), plan.shots - 1);
}

TEST_F(Selection, RefusesWithTheTerm) {
  EXPECT_THAT(ErrorOf("camera cam9"), AllOf(HasSubstr("cam9"), HasSubstr("demo")));
  EXPECT_THAT(ErrorOf("shots 20-10"), HasSubstr("ends before"));
  EXPECT_THAT(ErrorOf("shots 10-9999"), HasSubstr("0 to 112"));
  EXPECT_THAT(ErrorOf("shot -1"), HasSubstr("shot -1"));
  EXPECT_THAT(ErrorOf("shot 99999999999"), HasSubstr("a shot's number"));
  EXPECT_THAT(ErrorOf("everything"), HasSubstr("everything"));
  EXPECT_THAT(ErrorOf(" "), HasSubstr("empty"));
  EXPECT_THAT(ErrorOf("shot 3,,"), HasSubstr("\"\""));
  EXPECT_THAT(ErrorOf("sweep 2"), HasSubstr("2 sweeps"));
  EXPECT_THAT(ErrorOf("sweep 0, lamp lamp0"), HasSubstr("no frame"));
}

TEST_F(Selection, SurvivesMutation) {
  const std::string whole = "shots 10-20, camera \"cam3\", lamp lamp1, dark, sweep 1";
  std::mt19937 random(5);
  int refused = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string text = whole;
    text[random() % text.size()] = static_cast<char>(random());
    if (i % 2 == 0) text.resize(random() % text.size());
    const auto selection = ParseShotSelection(text, plan, rig);
    refused += !selection.ok();
    if (!selection.ok()) continue;
    for (const SelectedShot& shot : *selection) ASSERT_LT(shot.shot, plan.shots);
  }
  EXPECT_GT(refused, 500);
}

}  // namespace
}  // namespace mesorig
