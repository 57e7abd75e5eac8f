#include "processing/mesostructure/pixel_peak.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "processing/mesostructure/gaussian_peak.h"

namespace mesorig::mesostructure {
namespace {

constexpr double kReadNoise = 8, kFullWell = 20000;
constexpr double kStep = 1.5e-3;  // rad a frame

// The sheet passes frame `centre` of 64; a second one, `second_e` high, at `second`.
struct Pass {
  double centre = 30, sigma = 1.06, peak_e = 1500;
  double second = -1, second_e = 0;
  double jitter = 0;  // of the frames' tilts, in frames
  unsigned seed = 1;
};

std::vector<PixelSample> Samples(const Pass& pass) {
  std::mt19937 random(pass.seed);
  std::normal_distribution<double> normal;
  std::vector<PixelSample> samples;
  for (int k = 0; k < 64; ++k) {
    const double at = k + pass.jitter * std::sin(1.7 * k);
    const auto bell = [&](double centre) {
      return std::exp(-0.5 * (at - centre) * (at - centre) / (pass.sigma * pass.sigma));
    };
    const double mean = pass.peak_e * bell(pass.centre) + pass.second_e * bell(pass.second);
    const double e = mean + std::sqrt(mean + kReadNoise * kReadNoise) * normal(random);
    samples.push_back({at * kStep, static_cast<float>(std::min(e, kFullWell)), e >= kFullWell});
  }
  return samples;
}

PeakModel Model(double sigma) { return {kReadNoise, sigma * kStep}; }

// Frames; amplitude unknown (it is uncorrelated with the centre).
double CramerRao(const Pass& pass) {
  double information = 0;
  for (int k = 0; k < 64; ++k) {
    const double z = (k - pass.centre) / pass.sigma, mean = pass.peak_e * std::exp(-0.5 * z * z);
    const double slope = mean * z / pass.sigma;
    information += slope * slope / (mean + kReadNoise * kReadNoise);
  }
  return 1 / std::sqrt(information);
}

TEST(PixelPeak, NearTheCramerRaoBound) {
  for (const double fwhm : {2.0, 2.5, 3.0}) {
    double squares = 0, sum = 0, bound = 0;
    for (unsigned k = 0; k < 400; ++k) {
      Pass pass;
      pass.sigma = fwhm / kFwhmPerSigma, pass.centre = 30 + k / 400.0, pass.seed = k + 1;
      const auto peak = FindPixelPeak(Samples(pass), Model(pass.sigma));
      ASSERT_TRUE(peak.has_value());
      const double error = peak->tilt_rad / kStep - pass.centre;
      squares += error * error, sum += error;
      bound += CramerRao(pass) / 400;
      EXPECT_GT(peak->quality, 0.5);
    }
    const double rms = std::sqrt(squares / 400);
    EXPECT_LT(rms, 1.25 * bound) << "FWHM " << fwhm << " frames";
    EXPECT_LT(std::abs(sum / 400), 0.004) << "FWHM " << fwhm << " frames";
    std::printf("FWHM %.1f frames, 1500 e: %.4f frames, bound %.4f\n", fwhm, rms, bound);
  }
}

TEST(PixelPeak, FramesThatStandUnevenlyAndSweepsThatRunBackwards) {
  Pass pass;
  pass.jitter = 0.3, pass.centre = 30.37, pass.peak_e = 5000;
  auto samples = Samples(pass);
  const auto peak = FindPixelPeak(samples, Model(pass.sigma));
  ASSERT_TRUE(peak.has_value());
  EXPECT_NEAR(peak->tilt_rad / kStep, 30.37, 0.05);
  std::reverse(samples.begin(), samples.end());
  const auto back = FindPixelPeak(samples, Model(pass.sigma));
  ASSERT_TRUE(back.has_value());
  EXPECT_NEAR(back->tilt_rad, peak->tilt_rad, 1e-9);
}

TEST(PixelPeak, SaturatedIsToldByItsFlanksAndIsLessSure) {
  Pass pass;
  pass.peak_e = 60000, pass.sigma = 1.5, pass.centre = 30.3;
  const auto samples = Samples(pass);
  ASSERT_TRUE(samples[30].saturated);
  const auto peak = FindPixelPeak(samples, Model(pass.sigma));
  ASSERT_TRUE(peak.has_value());
  EXPECT_NEAR(peak->tilt_rad / kStep, 30.3, 0.15);
  auto all = samples;
  for (PixelSample& s : all) s.saturated = true, s.electrons = kFullWell;
  EXPECT_FALSE(FindPixelPeak(all, Model(pass.sigma)).has_value());
}

TEST(PixelPeak, NoPeakTwoPeaksEndsAndWrongWidthsAreRefused) {
  Pass none;
  none.peak_e = 0;
  EXPECT_FALSE(FindPixelPeak(Samples(none), Model(1.06)).has_value());
  Pass two;
  two.second = 45, two.second_e = 1200;
  EXPECT_FALSE(FindPixelPeak(Samples(two), Model(1.06)).has_value());
  two.second_e = 1500 * 0.35;
  const auto doubted = FindPixelPeak(Samples(two), Model(1.06));
  ASSERT_TRUE(doubted.has_value());
  EXPECT_LT(doubted->quality, 0.35);
  EXPECT_NEAR(doubted->tilt_rad / kStep, 30, 0.2);
  Pass end;
  end.centre = -0.6;
  EXPECT_FALSE(FindPixelPeak(Samples(end), Model(1.06)).has_value());
  end.centre = 63.6;
  EXPECT_FALSE(FindPixelPeak(Samples(end), Model(1.06)).has_value());
  Pass wide;
  wide.sigma = 6;
  const auto blurred = FindPixelPeak(Samples(wide), Model(1.06));
  EXPECT_TRUE(!blurred || blurred->quality < 0.1);
  Pass flat;
  flat.sigma = 1e6;
  EXPECT_FALSE(FindPixelPeak(Samples(flat), Model(1.06)).has_value());
}

TEST(PixelPeak, WhateverComesInNoNanComesOut) {
  std::mt19937 random(3);
  const float odd[] = {0,
                       -1e30f,
                       1e30f,
                       20000,
                       1,
                       std::numeric_limits<float>::infinity(),
                       std::numeric_limits<float>::quiet_NaN()};
  int found = 0;
  for (int round = 0; round < 3000; ++round) {
    std::vector<PixelSample> samples(random() % 12);
    for (PixelSample& s : samples) {
      s.tilt_rad = static_cast<double>(random() % 7) * kStep;  // also equal ones
      s.electrons = random() % 3 != 0 ? static_cast<float>(random() % 5000) : odd[random() % 7];
      s.saturated = random() % 5 == 0;
    }
    const auto peak = FindPixelPeak(samples, {8, random() % 4 == 0 ? 0 : kStep});
    if (!peak) continue;
    ++found;
    EXPECT_TRUE(std::isfinite(peak->tilt_rad) && std::isfinite(peak->variance));
    EXPECT_TRUE(peak->variance > 0 && peak->quality > 0 && peak->quality <= 1);
  }
  EXPECT_GT(found, 10);
}

}  // namespace
}  // namespace mesorig::mesostructure
