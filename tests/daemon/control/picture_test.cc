#include "daemon/control/picture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "daemon/control/metering.h"
#include "tests/daemon/fakes/bench.h"

namespace mesorig::daemon {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string Picture(int width, int height, const std::function<int(int x, int y)>& value) {
  std::string pixels;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int v = value(x, y);
      pixels.push_back(static_cast<char>(v & 0xFF));
      pixels.push_back(static_cast<char>(v >> 8));
    }
  }
  return pixels;
}

TEST(Picture, CountsSaturatedAndDarkPixels) {
  const Rig rig = SmallRig();
  const auto& camera = rig.cameras[0];  // black 64, white 4095
  const std::string pixels = Picture(16, 8, [](int x, int y) {
    if (y == 0) return 4095;
    return x < 4 ? 65 : 1000;
  });
  const PictureFigures figures = MeasurePicture(camera, 16, 8, pixels, 1);
  EXPECT_EQ(figures.pixels, 128u);
  EXPECT_EQ(figures.saturated, 16u);
  EXPECT_EQ(figures.dark, 28u);
  EXPECT_EQ(MeasurePicture(camera, 16, 8, "short", 1).pixels, 0u);
  EXPECT_EQ(MeasurePicture(camera, 0, 8, pixels, 1).pixels, 0u);
}

TEST(Picture, SharpnessFallsWithBlurAndNotWithLight) {
  const Rig rig = SmallRig();
  const auto& camera = rig.cameras[0];
  const auto wave = [&](double period, double light) {
    const std::string pixels = Picture(64, 64, [&](int x, int) {
      return 64 + static_cast<int>(light * (1 + std::sin(2 * kPi * x / period)));
    });
    return MeasurePicture(camera, 64, 64, pixels, 1).sharpness;
  };
  EXPECT_GT(wave(8, 500), 4 * wave(32, 500));
  EXPECT_NEAR(wave(8, 1000) / wave(8, 500), 1, 0.02);
  // A subsample says the same.
  EXPECT_EQ(StrideFor(1024, 768), 6);
  EXPECT_EQ(StrideFor(16, 8), 1);
}

TEST(Picture, AlarmsOnceUntilItClears) {
  PictureAlarms alarms;
  PictureFigures good, bright;
  good.pixels = bright.pixels = 1000;
  good.sharpness = bright.sharpness = 0.5;
  bright.saturated = 21;
  EXPECT_THAT(alarms.Judge(0, "C0", 1, good), IsEmpty());
  EXPECT_THAT(alarms.Judge(0, "C0", 1, bright),
              ElementsAre(HasSubstr("C0: 2.1 % of the pixels are saturated")));
  EXPECT_THAT(alarms.Judge(0, "C0", 1, bright), IsEmpty());
  EXPECT_EQ(alarms.Judge(1, "C1", 1, bright).size(), 1u) << "another camera";
  EXPECT_THAT(alarms.Judge(0, "C0", 1, good), IsEmpty());
  EXPECT_EQ(alarms.Judge(0, "C0", 1, bright).size(), 1u) << "again";
  PictureFigures dark = good;
  dark.dark = 996;
  EXPECT_THAT(alarms.Judge(0, "C0", 1, dark), ElementsAre(HasSubstr("are dark")));
  PictureFigures blurred = good;
  blurred.sharpness = 0.09;
  EXPECT_THAT(alarms.Judge(0, "C0", 1, blurred), ElementsAre(HasSubstr("blurred: sharpness 0.09")));
  EXPECT_THAT(alarms.Judge(0, "C0", 2, blurred), IsEmpty()) << "the first under this lamp";
}

TEST(Picture, RelativeDifferenceIsOfTheSignal) {
  const Rig rig = SmallRig();
  const auto& camera = rig.cameras[0];
  const std::string a = Picture(16, 8, [](int, int) { return 1064; });
  const std::string b = Picture(16, 8, [](int, int) { return 1104; });
  EXPECT_EQ(RelativeDifference(camera, a, a).value(), 0);
  EXPECT_NEAR(RelativeDifference(camera, a, b).value(), 0.04, 1e-12);
  const std::string black = Picture(16, 8, [](int, int) { return 64; });
  EXPECT_EQ(RelativeDifference(camera, black, black).value(), 0);
  EXPECT_GT(RelativeDifference(camera, black, a).value(), 1);
  EXPECT_TRUE(absl::IsInvalidArgument(RelativeDifference(camera, a, "x").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(RelativeDifference(camera, "", "").status()));
}

TEST(Metering, FewestBadPixelsAndOfEqualsTheLongest) {
  EXPECT_EQ(ChooseExposure({0.01, 0.02, 0.04}, {5, 3, 9}), 0.02);
  EXPECT_EQ(ChooseExposure({0.01, 0.02, 0.04}, {3, 3, 3}), 0.04);
  EXPECT_EQ(ChooseExposure({0.01}, {7}), 0.01);
}

// A plan whose shots take what a meter chose.
CompiledPlan MeteredPlan(const Rig& rig) {
  CompiledPlan plan = SmallPlan(rig);
  Step meter;
  meter.kind = StepKind::kMeter;
  meter.meter = 0;
  meter.cameras = {0, 1};
  meter.ladder_s = {0.005, 0.02, 0.08};
  plan.steps.insert(plan.steps.begin() + 2, meter);
  for (Step& step : plan.steps) {
    if (step.kind == StepKind::kShot && step.shot < 2) step.meter = 0;
  }
  return plan;
}

TEST(Metering, ShotsTakeTheExposureThatWasChosen) {
  Bench bench;
  for (auto& camera : bench.cameras) {
    // Half the field is a hundred times as bright as the other.
    camera->picture = [](uint32_t, double exposure_s, size_t bytes) {
      const int bright = std::min(4095, 64 + static_cast<int>(exposure_s * 2e5));
      const int dim = 64 + static_cast<int>(exposure_s * 2e3);
      return Picture(16, static_cast<int>(bytes / 32),
                     [&](int x, int) { return x < 8 ? bright : dim; });
    };
  }
  const SequencerEvent end = bench.Run(MeteredPlan(bench.rig));
  EXPECT_TRUE(end.complete) << end.text;
  const auto records = bench.session->records();
  ASSERT_EQ(records.size(), 5u) << "what the meter shot is in no ledger";
  // 0.08 s saturates the bright half; of the two others the longer.
  EXPECT_EQ(bench.session->MeteredExposure(0), 0.02);
  EXPECT_EQ(records[0].exposure_s, 0.02);
  EXPECT_EQ(records[4].exposure_s, 0.04) << "not metered";
  // On resume it is not metered again.
  bench.session->Reopen();
  bench.session->Lose(1, 0);
  const double chosen = *bench.session->MeteredExposure(0);
  EXPECT_TRUE(bench.Run(MeteredPlan(bench.rig), SequencerCommand::kResume).complete);
  EXPECT_EQ(bench.session->Journaled(JournalKind::kExposure), 1);
  EXPECT_EQ(bench.session->records().back().exposure_s, chosen);
}

}  // namespace
}  // namespace mesorig::daemon
