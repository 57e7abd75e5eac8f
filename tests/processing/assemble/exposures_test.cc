// Brackets, repeats and frames in the dark: known radiances through a sensor with its noise.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <random>

#include "processing/assemble/assembler.h"
#include "processing/image/radiance.h"
#include "tests/processing/assemble/synthetic_session.h"

namespace mesorig::assemble {
namespace {

using ::testing::HasSubstr;

constexpr int kSize = 24;
constexpr double kShort_s = 0.02, kLong_s = 0.32;

std::string Plan(std::string_view exposures, std::string_view more = "") {
  return fmt::format(
      "name = \"test\"\n[sample]\nname = \"plane\"\n[product]\nwidth_px = {0}\nheight_px = {0}\n"
      "pitch_mm = 1\nh_ref_mm = 4.5\n[[grid]]\n{1}\nlamps = [\"lamp3\"]\ncameras = [\"cam4\"]\n"
      "[grid.axes.turntable]\nangles_deg = [0]\n[grid.axes.light_arc]\nangles_deg = [90]\n{2}",
      kSize, exposures, more);
}

class Exposures : public ::testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove_all(dir_); }
  std::unique_ptr<Assembler> Make(const std::string& text, const char* work = "work") {
    std::filesystem::create_directories(dir_);
    const auto plan = CompilePlan(text, "test.toml", rig_);
    EXPECT_TRUE(plan.ok()) << plan.status();
    auto made = Assembler::Create(rig_, *plan, dir_ / work);
    EXPECT_TRUE(made.ok()) << made.status();
    return std::move(made).value();
  }
  // A sensor that sees the same radiance everywhere: Poisson and read noise (here by normal
  // distributions), full well, quantisation; `pedestal_dn` is light that leaks in.
  std::string Frame(double radiance, double exposure_s, uint32_t seed,
                    double pedestal_dn = 0) const {
    const Camera& camera = rig_.cameras[4];
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    const double dn_per_e = (camera.white_dn() - camera.black_dn) / camera.full_well_e;
    const double mean = radiance * camera.electrons_per_radiance_s * exposure_s;
    std::string bytes;
    for (int i = 0; i < camera.width * camera.height; ++i) {
      const double electrons =
          std::min(mean + std::sqrt(mean) * normal(random), camera.full_well_e) +
          camera.read_noise_e * normal(random);
      const double code = camera.black_dn + pedestal_dn + electrons * dn_per_e;
      const int dn = static_cast<int>(std::lround(std::clamp(code, 0.0, 4095.0)));
      bytes.push_back(static_cast<char>(dn & 0xff));
      bytes.push_back(static_cast<char>(dn >> 8));
    }
    return bytes;
  }
  FrameInfo Info(uint32_t shot, double exposure_s, uint64_t sequence) const {
    Shot at{0, 90, 3};
    at.exposure_s = exposure_s;
    return InfoOf(rig_, at, 4, shot, sequence);
  }
  FrameInfo DarkInfo(uint32_t shot, double exposure_s, uint64_t sequence) const {
    FrameInfo info = Info(shot, exposure_s, sequence);
    info.lamp_level.assign(rig_.lamps.size(), 0.0);
    return info;
  }
  std::vector<float> Values(const Assembler& assembler) {
    figures_ = {};
    const auto built = assembler.BuildBtf(figures_);
    EXPECT_TRUE(built.ok()) << built.status();
    return {built->Image(0, 0).begin(), built->Image(0, 0).end()};
  }
  // Mean and standard deviation of the radiance of green, over the texels.
  std::pair<double, double> Green(const std::vector<float>& values) const {
    double sum = 0, squares = 0;
    for (int t = 0; t < kSize * kSize; ++t) {
      const double x = (t % kSize + 0.5 - kSize / 2.0), y = (kSize / 2.0 - t / kSize - 0.5);
      const Shot shot{0, 90, 3};
      const double value = static_cast<double>(values[static_cast<size_t>(3 * t + 1)]);
      const double radiance = value * RadianceOf(
                                          shot, [](double, double, int) { return 1.0; }, x, y, 1);
      sum += radiance, squares += radiance * radiance;
    }
    const double n = kSize * kSize, mean = sum / n;
    return {mean, std::sqrt(squares / n - mean * mean)};
  }
  std::vector<float> Developed(const std::vector<double>& exposures_s, double radiance) {
    std::string list;
    for (const double e : exposures_s) list += fmt::format("{}{}", list.empty() ? "" : ", ", e);
    auto assembler = Make(Plan(fmt::format("exposures_s = [{}]", list)));
    for (uint32_t k = 0; k < exposures_s.size(); ++k) {
      const uint32_t seed = exposures_s[k] == kShort_s ? 1 : 2;  // the same frames in each test
      EXPECT_TRUE(
          assembler->Add(Info(k, exposures_s[k], k + 1), Frame(radiance, exposures_s[k], seed))
              .ok());
    }
    return Values(*assembler);
  }

  const std::filesystem::path dir_ =
      std::filesystem::path(::testing::TempDir()) /
      fmt::format("exposures_{}_{}", ::getpid(),
                  ::testing::UnitTest::GetInstance()->current_test_info()->name());
  const Rig rig_ = DemoRig();
  PackFigures figures_;
};

// 1:16. 12 W m^-2 sr^-1 give 9,600 of 20,000 electrons in 20 ms and saturate in 320 ms: the short
// one alone tells them, without a bias.
TEST_F(Exposures, ABracketTellsWhatSaturatesTheLongOne) {
  const auto [alone, alone_noise] = Green(Developed({kShort_s}, 12));
  const std::vector<float> both = Developed({kShort_s, kLong_s}, 12);
  EXPECT_EQ(figures_.clipped_texels, 0u);
  EXPECT_EQ(both, Developed({kShort_s}, 12)) << "the saturated frame leaves no trace";
  EXPECT_NEAR(alone, 12, 0.02);
  EXPECT_LT(alone_noise, 12 * 0.02);
}

// 0.2 give 160 electrons in 20 ms and 2,560 in 320 ms. Predicted: the variances' parallel sum.
TEST_F(Exposures, ABracketHasThePredictedError) {
  const double radiance = 0.2;
  const Camera& camera = rig_.cameras[4];
  const auto [short_mean, short_noise] = Green(Developed({kShort_s}, radiance));
  const auto [long_mean, long_noise] = Green(Developed({kLong_s}, radiance));
  const auto [mean, noise] = Green(Developed({kShort_s, kLong_s}, radiance));
  const double short_variance = image::RadianceVariance(camera, radiance, kShort_s);
  const double long_variance = image::RadianceVariance(camera, radiance, kLong_s);
  const double variance = 1 / (1 / short_variance + 1 / long_variance);
  EXPECT_NEAR(mean, radiance, 1e-3 * radiance + 0.1 * noise);
  EXPECT_NEAR(short_noise / long_noise, std::sqrt(short_variance / long_variance), 0.35);
  EXPECT_NEAR(noise / short_noise, std::sqrt(variance / short_variance),
              0.1 * std::sqrt(variance / short_variance));
  // A mean without weights would be this bad:
  EXPECT_LT(noise, 0.5 * std::sqrt(short_noise * short_noise + long_noise * long_noise) / 2);
}

// 100 saturate both: the shorter one's bound is the greater, and each texel is counted once.
TEST_F(Exposures, WhatAllSaturateIsALowerBound) {
  const std::vector<float> both = Developed({kShort_s, kLong_s}, 100);
  EXPECT_EQ(figures_.clipped_texels, static_cast<uint64_t>(kSize * kSize));
  const auto [mean, noise] = Green(both);
  EXPECT_NEAR(mean, 25, 0.1) << "20,000 electrons in 20 ms";
}

TEST_F(Exposures, RepeatsAreThePlainMean) {
  auto assembler = Make(Plan("exposure_s = 0.02\nrepeats = 4"));
  std::vector<std::vector<float>> each;
  for (uint32_t k = 0; k < 4; ++k) {
    const std::string frame = Frame(5, kShort_s, 10 + k);
    ASSERT_TRUE(assembler->Add(Info(k, kShort_s, k + 1), frame).ok());
    auto one = Make(Plan("exposure_s = 0.02"), "one");
    ASSERT_TRUE(one->Add(Info(0, kShort_s, 1), frame).ok());
    each.push_back(Values(*one));
  }
  const std::vector<float> mean = Values(*assembler);
  EXPECT_EQ(figures_.merged_frames, 3u);
  for (size_t i = 0; i < mean.size(); ++i) {
    double sum = 0;
    for (const auto& values : each) sum += static_cast<double>(values[i]);
    EXPECT_EQ(mean[i], static_cast<float>(0.25 * sum));
  }
}

// Ambient light of 40 code values: with ambient frames the radiance is what it was without.
constexpr std::string_view kAmbient = "[[calibration]]\nkind = \"ambient\"\nrepeats = 8\n";

TEST_F(Exposures, AmbientLightGoes) {
  for (const bool corrected : {true, false}) {
    auto assembler = Make(Plan("exposure_s = 0.02", corrected ? kAmbient : ""));
    uint32_t shot = 0;
    for (; corrected && shot < 8; ++shot) {
      ASSERT_TRUE(
          assembler->Add(DarkInfo(shot, kShort_s, shot + 1), Frame(0, kShort_s, 50 + shot, 40))
              .ok());
    }
    ASSERT_TRUE(assembler->Add(Info(shot, kShort_s, shot + 1), Frame(5, kShort_s, 7, 40)).ok());
    const double mean = Green(Values(*assembler)).first;
    EXPECT_NEAR(mean, corrected ? 5 : 5 + 40 * 20000.0 / 4031 / 800, 0.01);
    EXPECT_EQ(assembler->tally().ambient, corrected ? 8u : 0u);
    EXPECT_EQ(assembler->tally().refused, 0u);
    EXPECT_FALSE(assembler->NeedsAgain(4));
  }
}

// A dark frame that comes, or comes again, after the frames that need it: these are asked for once
// more, and then nothing tells in which order all came.
TEST_F(Exposures, OrderOfDarkFramesDoesNotMatter) {
  const std::string text =
      Plan("exposure_s = 0.02", "[[calibration]]\nkind = \"dark\"\nrepeats = 2\n");
  const std::string data = Frame(5, kShort_s, 7, 10);
  const std::string dark[2] = {Frame(0, kShort_s, 8, 10), Frame(0, kShort_s, 9, 12)};
  auto in_order = Make(text);
  for (uint32_t k = 0; k < 2; ++k) {
    ASSERT_TRUE(in_order->Add(DarkInfo(k, kShort_s, k + 1), dark[k]).ok());
  }
  ASSERT_TRUE(in_order->Add(Info(2, kShort_s, 3), data).ok());
  const std::vector<float> expected = Values(*in_order);
  auto late = Make(text, "late");
  ASSERT_TRUE(late->Add(DarkInfo(0, kShort_s, 1), Frame(0, kShort_s, 99, 400)).ok());
  ASSERT_TRUE(late->Add(Info(2, kShort_s, 2), data).ok());
  EXPECT_FALSE(late->NeedsAgain(4));
  ASSERT_TRUE(late->Add(DarkInfo(1, kShort_s, 3), dark[1]).ok());
  ASSERT_TRUE(late->Add(DarkInfo(0, kShort_s, 4), dark[0]).ok()) << "shot again";
  EXPECT_TRUE(late->NeedsAgain(4));
  EXPECT_FALSE(late->NeedsAgain(3));
  EXPECT_NE(Values(*late), expected);
  ASSERT_TRUE(late->Add(DarkInfo(0, kShort_s, 1), Frame(0, kShort_s, 99, 400)).ok());
  ASSERT_TRUE(late->Add(Info(2, kShort_s, 2), data).ok());
  EXPECT_FALSE(late->NeedsAgain(4));
  EXPECT_EQ(Values(*late), expected);
  EXPECT_EQ(late->tally().superseded, 1u);
  EXPECT_EQ(late->tally().dark, 2u);
}

TEST_F(Exposures, FlatFramesAreCountedAndLeaveNoTrace) {
  auto plain = Make(Plan("exposure_s = 0.02"));
  ASSERT_TRUE(plain->Add(Info(0, kShort_s, 1), Frame(5, kShort_s, 7)).ok());
  const std::vector<float> expected = Values(*plain);
  auto flat = Make(Plan("exposure_s = 0.02", "[[calibration]]\nkind = \"flat\"\n"), "flat");
  ASSERT_TRUE(flat->Add(Info(0, kShort_s, 1), Frame(9, kShort_s, 8)).ok());
  ASSERT_TRUE(flat->Add(Info(1, kShort_s, 2), Frame(5, kShort_s, 7)).ok());
  EXPECT_EQ(Values(*flat), expected);
  EXPECT_EQ(flat->tally().flat, 1u);
}

TEST_F(Exposures, CalibrationFramesAloneAreNoBtf) {
  const std::string text =
      "name = \"test\"\n[sample]\nname = \"plane\"\n[product]\nwidth_px = 8\nheight_px = 8\n"
      "pitch_mm = 1\nh_ref_mm = 4.5\n[[calibration]]\nkind = \"dark\"\nexposures_s = [0.02]\n"
      "cameras = [\"cam4\"]\n";
  const auto plan = CompilePlan(text, "test.toml", rig_);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_TRUE(Assembler::HasShots(*plan));
  EXPECT_FALSE(Assembler::HasData(*plan));
  auto assembler = Make(text);
  ASSERT_TRUE(assembler->Add(DarkInfo(0, kShort_s, 1), Frame(0, kShort_s, 8)).ok());
  EXPECT_EQ(assembler->tally().frames, 1u);
  EXPECT_TRUE(absl::IsFailedPrecondition(assembler->BuildBtf(figures_).status()));
  EXPECT_THAT(std::string(Message(assembler->Add(DarkInfo(0, kShort_s, 2), "short"))),
              HasSubstr("camera 4, shot 0"));
}

}  // namespace
}  // namespace mesorig::assemble
