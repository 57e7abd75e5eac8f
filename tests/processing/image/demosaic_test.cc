#include "processing/image/demosaic.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mesorig::image {
namespace {

// A picture whose colour c is a_c + b_c column + d_c row.
MosaicImage Ramp(BayerPattern pattern, double slope) {
  MosaicImage image{20, 20, pattern, {}, {}};
  for (int row = 0; row < 20; ++row) {
    for (int column = 0; column < 20; ++column) {
      const int c = ColourAt(pattern, column, row);
      image.radiance.push_back(static_cast<float>(1 + c + slope * (column + 2 * c * row)));
    }
  }
  return image;
}

TEST(ColourAt, IsRggb) {
  EXPECT_EQ(ColourAt(BayerPattern::kRggb, 0, 0), 0);
  EXPECT_EQ(ColourAt(BayerPattern::kRggb, 1, 0), 1);
  EXPECT_EQ(ColourAt(BayerPattern::kRggb, 0, 1), 1);
  EXPECT_EQ(ColourAt(BayerPattern::kRggb, 1, 1), 2);
}

TEST(Demosaic, KeepsConstantColoursUpToTheBorder) {
  for (const PixelModel model : {PixelModel::kAverage, PixelModel::kCentre}) {
    const auto rgb = Demosaic(Ramp(BayerPattern::kRggb, 0), model);
    ASSERT_TRUE(rgb.ok()) << rgb.status();
    for (size_t k = 0; k < rgb->rgb.size(); ++k) {
      ASSERT_NEAR(rgb->rgb[k], 1.0 + static_cast<double>(k % 3), 1e-6);
    }
  }
}

TEST(Demosaic, IsExactOnRamps) {
  const auto rgb = Demosaic(Ramp(BayerPattern::kRggb, 0.1));
  ASSERT_TRUE(rgb.ok());
  for (int row = 8; row < 12; ++row) {  // mirrored borders have no slope, and reach inwards
    for (int column = 8; column < 12; ++column) {
      for (int c = 0; c < 3; ++c) {
        ASSERT_NEAR(rgb->rgb[static_cast<size_t>(3 * (row * 20 + column) + c)],
                    1 + c + 0.1 * (column + 2 * c * row), 1e-5);
      }
    }
  }
}

// Means of x^2 over unit pixels are x^2 + 1/12: the centre's value is 1/12 below, exactly.
TEST(Demosaic, CentreValuesOfAParabola) {
  MosaicImage mono{9, 6, BayerPattern::kMono, {}, {}};
  for (int k = 0; k < 54; ++k) {
    mono.radiance.push_back(static_cast<float>((k % 9) * (k % 9) + 1.0 / 12));
  }
  const auto rgb = Demosaic(mono);
  ASSERT_TRUE(rgb.ok());
  for (int column = 2; column < 7; ++column) {
    EXPECT_NEAR(rgb->rgb[static_cast<size_t>(3 * (3 * 9 + column) + 1)], column * column, 1e-5);
  }
}

// Two dyes under one light that changes fast: every colour is a multiple of the light in each half.
// The lines find it, where interpolation of red's own pixels cannot.
TEST(Demosaic, FindsTheLightThatTheColoursShare) {
  MosaicImage image{40, 40, BayerPattern::kRggb, {}, {}};
  const auto truth = [](int column, int row, int c) {
    const double dye[2][3] = {{0.5, 0.4, 0.2}, {0.2, 0.3, 0.6}};
    const double light = 1 + 0.6 * std::sin(1.9 * column + 0.4 * row);
    return dye[column < 20 ? 0 : 1][c] * light;
  };
  for (int k = 0; k < 1600; ++k) {
    image.radiance.push_back(
        static_cast<float>(truth(k % 40, k / 40, ColourAt(image.pattern, k % 40, k / 40))));
  }
  const auto rgb = Demosaic(image, PixelModel::kAverage);
  ASSERT_TRUE(rgb.ok());
  double lines = 0, own = 0;
  for (int row = 6; row < 34; ++row) {
    for (int column = 7; column < 34; column += 2) {  // red between two red pixels of an even row
      if (row % 2 != 0) continue;
      const double t = truth(column, row, 0);
      const double mean = (truth(column - 1, row, 0) + truth(column + 1, row, 0)) / 2;
      lines += std::pow(rgb->rgb[static_cast<size_t>(3 * (row * 40 + column))] - t, 2);
      own += std::pow(mean - t, 2);
    }
  }
  EXPECT_LT(lines, own / 4);
}

TEST(Demosaic, ABlackPictureStaysBlackAndFinite) {
  const auto rgb = Demosaic({8, 8, BayerPattern::kRggb, std::vector<float>(64), {}});
  ASSERT_TRUE(rgb.ok());
  for (const float value : rgb->rgb) EXPECT_EQ(value, 0);
}

// A pixel's windows reach farther than its flag; beyond the flag little of its value arrives.
TEST(Demosaic, SpreadsTheSaturationFlagAsFarAsTheValueReaches) {
  MosaicImage image = Ramp(BayerPattern::kRggb, 0);
  image.saturated.assign(400, 0);
  image.saturated[9 * 20 + 10] = 1;
  const auto before = Demosaic(image);
  image.radiance[9 * 20 + 10] += 100;
  const auto after = Demosaic(image);
  ASSERT_TRUE(before.ok() && after.ok());
  for (size_t k = 0; k < after->rgb.size(); ++k) {
    const double change = std::abs(after->rgb[k] - before->rgb[k]);
    EXPECT_TRUE(change < 0.01 * 100 || after->saturated[k / 3] == 1) << k / 3 << " " << change;
  }
}

TEST(Demosaic, RefusesTinyImages) {
  EXPECT_TRUE(absl::IsInvalidArgument(
      Demosaic({3, 8, BayerPattern::kRggb, std::vector<float>(24), {}}).status()));
}

}  // namespace
}  // namespace mesorig::image
