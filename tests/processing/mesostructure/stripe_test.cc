#include "processing/mesostructure/stripe.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "processing/mesostructure/gaussian_peak.h"

namespace mesorig::mesostructure {
namespace {

using ::testing::HasSubstr;

constexpr double kReadNoise = 8;  // electrons
constexpr double kFullWell = 20000;

// Mean of the Gaussian over a pixel: what a sensor measures.
double PixelMean(double from, double centre, double sigma) {
  const auto integral = [&](double x) {
    return 0.5 * std::erf((x - centre) / (sigma * std::sqrt(2.0)));
  };
  return sigma * std::sqrt(2 * std::numbers::pi) * (integral(from + 1) - integral(from));
}

// Electrons of a stripe u = position + slope (v - height/2), quantised to 12 bits, with the demo's
// noise.
struct Scene {
  int width = 60, height = 40;
  double position = 30, slope = 0, fwhm = 6, peak = 1500, background = 20;
  double second = -1, second_peak = 0;  // another stripe
  unsigned seed = 1;
};

StripeImage Render(const Scene& s) {
  std::mt19937 random(s.seed);
  std::normal_distribution<double> normal;
  StripeImage image;
  image.width = s.width, image.height = s.height;
  image.noise = std::sqrt(kReadNoise * kReadNoise + s.background), image.shot = 1;
  image.saturation = static_cast<float>(kFullWell * 0.998);
  for (int j = 0; j < s.height; ++j) {
    const double shift = s.slope * (j + 0.5 - s.height / 2.0);
    for (int i = 0; i < s.width; ++i) {
      const double sigma = s.fwhm / kFwhmPerSigma;
      double mean = s.background + s.peak * PixelMean(i, s.position + shift, sigma);
      if (s.second >= 0) mean += s.second_peak * PixelMean(i, s.second + shift, sigma);
      double e = mean + std::sqrt(mean + kReadNoise * kReadNoise) * normal(random);
      e = std::min(e, kFullWell);
      image.value.push_back(
          static_cast<float>(std::round(e / kFullWell * 4095) / 4095 * kFullWell));
    }
  }
  return image;
}

TEST(StripeCentroid, WithinATwentiethOfAPixelAtTheDemosNoise) {
  for (const double fwhm : {2.0, 5.0, 6.5, 8.0}) {
    double squares = 0, sum = 0, variance = 0;
    int count = 0;
    for (unsigned k = 0; k < 20; ++k) {
      Scene scene;
      scene.fwhm = fwhm, scene.seed = k, scene.position = 30 + k / 20.0;
      for (const StripeCandidate& c : FindStripe(Render(scene), Profiles::kRows, {})) {
        const double error = c.across - scene.position;
        squares += error * error, sum += error, variance += c.variance, ++count;
      }
    }
    ASSERT_EQ(count, 800) << "FWHM " << fwhm;
    const double rms = std::sqrt(squares / count);
    EXPECT_LT(rms, 0.05) << "FWHM " << fwhm;
    EXPECT_LT(std::abs(sum / count), 0.005) << "FWHM " << fwhm;
    // It knows its own error.
    EXPECT_NEAR(std::sqrt(variance / count) / rms, 1, 0.25) << "FWHM " << fwhm;
  }
}

TEST(StripeCentroid, OnEverySecondPixelAsOnABayerSensor) {
  Scene scene;
  scene.fwhm = 7.7, scene.position = 30.3;
  StripeImage image = Render(scene);
  for (int j = 0; j < image.height; ++j) {
    for (int i = 0; i < image.width; ++i) image.usable.push_back((i + j) % 2 != 0 ? 1 : 0);
  }
  double squares = 0;
  const auto candidates = FindStripe(image, Profiles::kRows, {});
  ASSERT_EQ(candidates.size(), 40u);
  for (const StripeCandidate& c : candidates) squares += std::pow(c.across - scene.position, 2);
  EXPECT_LT(std::sqrt(squares / 40), 0.07);
}

TEST(StripeCentroid, SaturatedIsFoundByItsFlanksAndWeighsLess) {
  Scene scene;
  scene.fwhm = 8, scene.peak = 15000, scene.position = 30.4;
  const auto good = FindStripe(Render(scene), Profiles::kRows, {});
  scene.peak = 60000;
  const auto clipped = FindStripe(Render(scene), Profiles::kRows, {});
  ASSERT_EQ(clipped.size(), 40u);
  double squares = 0;
  for (const StripeCandidate& c : clipped) {
    squares += std::pow(c.across - scene.position, 2);
    EXPECT_TRUE(std::isfinite(c.across) && c.variance > 0);
  }
  EXPECT_LT(std::sqrt(squares / 40), 0.1);
  EXPECT_GT(good.size(), 39u);
  // Nothing but saturation: no flanks, no position.
  scene.fwhm = 400, scene.peak = 1e6;
  EXPECT_TRUE(FindStripe(Render(scene), Profiles::kRows, {}).empty());
}

TEST(StripeCentroid, NoStripeTwoStripesAndTheEdgeAreRefused) {
  Scene none;
  none.peak = 0;
  EXPECT_LE(FindStripe(Render(none), Profiles::kRows, {}).size(), 1u);
  Scene two;
  two.position = 18, two.second = 42, two.second_peak = 1200;
  EXPECT_TRUE(FindStripe(Render(two), Profiles::kRows, {}).empty());
  two.second_peak = 1500 * 0.4;
  Scene one = two;
  one.second = -1;
  const auto doubted = FindStripe(Render(two), Profiles::kRows, {});
  const auto sure = FindStripe(Render(one), Profiles::kRows, {});
  ASSERT_GE(doubted.size(), 38u);
  EXPECT_GT(doubted[3].variance, 2 * sure[3].variance);
  Scene edge;
  edge.position = 0.5;
  EXPECT_TRUE(FindStripe(Render(edge), Profiles::kRows, {}).empty());
}

TEST(StripeCentroid, NothingIsMadeOfNothing) {
  StripeImage image;
  image.width = 30, image.height = 20;
  image.value.assign(600, 0.0f);
  EXPECT_TRUE(FindStripe(image, Profiles::kRows, {}).empty());
  image.value.assign(600, 4095.0f);
  image.saturation = 4000;
  EXPECT_TRUE(FindStripe(image, Profiles::kRows, {}).empty());
  image.value.assign(600, std::numeric_limits<float>::quiet_NaN());
  EXPECT_TRUE(FindStripe(image, Profiles::kColumns, {}).empty());
  image.value.assign(600, std::numeric_limits<float>::infinity());
  EXPECT_TRUE(FindStripe(image, Profiles::kColumns, {}).empty());
  StripeImage empty;
  EXPECT_TRUE(FindStripe(empty, Profiles::kRows, {}).empty());
}

TEST(StripeLine, PositionAngleAndTheirErrors) {
  double squares = 0, expected = 0;
  for (unsigned k = 0; k < 30; ++k) {
    Scene scene;
    scene.slope = 0.3, scene.seed = k + 100, scene.position = 30.2;
    const StripeImage image = Render(scene);
    ASSERT_EQ(ChooseProfiles(image, {}), Profiles::kRows);
    const auto line = FitStripeLine(FindStripe(image, Profiles::kRows, {}), Profiles::kRows, {});
    ASSERT_TRUE(line.ok()) << line.status();
    EXPECT_NEAR(line->slope, 0.3, 0.005);
    squares += std::pow(line->At(20) - scene.position, 2), expected += line->VarianceAt(20);
  }
  EXPECT_LT(std::sqrt(squares / 30), 0.012);
  EXPECT_NEAR(std::sqrt(squares / expected), 1, 0.3);
}

TEST(StripeLine, ColumnsAreRowsTurned) {
  Scene scene;
  scene.slope = 0.2;
  const StripeImage image = Render(scene);
  StripeImage turned = image;
  turned.width = image.height, turned.height = image.width;
  for (int j = 0; j < image.height; ++j) {
    for (int i = 0; i < image.width; ++i) {
      turned.value[static_cast<size_t>(i * turned.width + j)] =
          image.value[static_cast<size_t>(j * image.width + i)];
    }
  }
  EXPECT_EQ(ChooseProfiles(turned, {}), Profiles::kColumns);
  const auto a = FitStripeLine(FindStripe(image, Profiles::kRows, {}), Profiles::kRows, {});
  const auto b = FitStripeLine(FindStripe(turned, Profiles::kColumns, {}), Profiles::kColumns, {});
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_EQ(a->position, b->position);
  EXPECT_EQ(a->slope, b->slope);
}

TEST(StripeLine, OutliersDoNotMoveIt) {
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  std::vector<StripeCandidate> candidates;
  for (int k = 0; k < 100; ++k) {
    const double along = k + 0.5;
    const double across = 12 + 0.1 * along + 0.03 * normal(random);
    candidates.push_back({along, k % 5 < 2 ? across + 5 + 0.2 * (k % 7) : across, 0.001, 2, 100});
  }
  const auto line = FitStripeLine(candidates, Profiles::kRows, {});
  ASSERT_TRUE(line.ok()) << line.status();
  EXPECT_NEAR(line->At(50), 17, 0.02);
  EXPECT_EQ(line->inliers, 60);
}

TEST(StripeLine, RefusalsSayWhy) {
  std::vector<StripeCandidate> candidates(5, StripeCandidate{1, 2, 0.01, 2, 100});
  const auto why = [&] {
    const auto line = FitStripeLine(candidates, Profiles::kRows, {});
    EXPECT_EQ(line.status().code(), absl::StatusCode::kFailedPrecondition);
    return std::string(Message(line.status()));
  };
  EXPECT_THAT(why(), HasSubstr("shows in 5 profiles"));
  candidates.resize(40, candidates[0]);
  EXPECT_THAT(why(), HasSubstr("all of it shows in one profile"));
  std::mt19937 random(5);
  for (StripeCandidate& c : candidates) {
    c.along = static_cast<double>(random() % 100), c.across = static_cast<double>(random() % 100);
  }
  EXPECT_THAT(why(), HasSubstr("scatter"));
}

}  // namespace
}  // namespace mesorig::mesostructure
