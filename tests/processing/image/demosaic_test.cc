#include "processing/image/demosaic.h"

#include <gtest/gtest.h>

namespace mesorig::image {
namespace {

// A picture whose colour c is a_c + b_c column + d_c row.
MosaicImage Ramp(BayerPattern pattern, double slope) {
  MosaicImage image{12, 10, pattern, {}, {}};
  for (int row = 0; row < 10; ++row) {
    for (int column = 0; column < 12; ++column) {
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
  for (int row = 3; row < 7; ++row) {
    for (int column = 3; column < 9; ++column) {
      for (int c = 0; c < 3; ++c) {
        ASSERT_NEAR(rgb->rgb[static_cast<size_t>(3 * (row * 12 + column) + c)],
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

TEST(Demosaic, SpreadsTheSaturationFlagAsFarAsTheValueReaches) {
  MosaicImage image = Ramp(BayerPattern::kRggb, 0);
  image.saturated.assign(120, 0);
  image.saturated[5 * 12 + 6] = 1;
  const auto before = Demosaic(image);
  image.radiance[5 * 12 + 6] += 100;
  const auto after = Demosaic(image);
  ASSERT_TRUE(before.ok() && after.ok());
  for (size_t k = 0; k < after->rgb.size(); ++k) {
    EXPECT_TRUE(before->rgb[k] == after->rgb[k] || after->saturated[k / 3] == 1) << k / 3;
  }
}

TEST(Demosaic, RefusesTinyImages) {
  EXPECT_TRUE(absl::IsInvalidArgument(
      Demosaic({3, 8, BayerPattern::kRggb, std::vector<float>(24), {}}).status()));
}

}  // namespace
}  // namespace mesorig::image
