#include "processing/codecs/space_filter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/processing/codecs/encoding.h"

namespace mesorig::codecs {
namespace {

// Linear in x and y, different in each channel.
std::array<float, 3> Ramp(int x, int y) {
  return {static_cast<float>(x), static_cast<float>(10 * y), static_cast<float>(x + 100 * y)};
}

TEST(SpaceFilter, IsTheTexelAtItsCentreAndLinearBetween) {
  const auto at = [](double x, double y) { return FilteredInSpace(8, 4, Ramp, x / 8, y / 4, 0); };
  EXPECT_THAT(at(2.5, 1.5), ::testing::ElementsAre(2, 10, 102));
  EXPECT_THAT(at(3.25, 1.5), ::testing::ElementsAre(2.75, 10, 102.75));
  EXPECT_THAT(at(3.25, 2.0), ::testing::ElementsAre(2.75, 15, 152.75));
}

TEST(SpaceFilter, TheSampleRepeats) {
  const auto at = [](double u, double v) { return FilteredInSpace(8, 4, Ramp, u, v, 0); };
  EXPECT_THAT(at(0, 0.125), ::testing::ElementsAre(3.5, 0, 3.5))
      << "between the last and the first";
  for (const double repeats : {-3.0, 1.0, 1e6}) {
    EXPECT_THAT(at(repeats + 0.3125, 0.375 - repeats), ::testing::ElementsAre(2, 10, 102))
        << repeats;
  }
}

TEST(SpaceFilter, LevelsAreMeansOverAreas) {
  const auto at = [](double x, double y, double level) {
    return FilteredInSpace(8, 4, Ramp, x / 8, y / 4, level);
  };
  EXPECT_THAT(at(3, 1, 1), ::testing::ElementsAre(2.5, 5, 52.5)) << "a texel of level 1";
  EXPECT_THAT(at(2, 2, 2), ::testing::ElementsAre(1.5, 15, 151.5));
  EXPECT_THAT(at(3, 1, 0.5)[0], ::testing::DoubleNear(2.5, 1e-12)) << "between levels";
  for (const double level : {3.0, 3.7, 100.0}) {
    EXPECT_THAT(at(1, 3, level), ::testing::ElementsAre(3.5, 15, 153.5)) << "all of it, " << level;
  }
}

// Five texels are two of level 1, of two and a half each; three are one.
TEST(SpaceFilter, SizesThatAreNoPowerOfTwoLoseNothing) {
  const auto at = [](double x, double level) {
    return FilteredInSpace(5, 3, Ramp, x / 5, 0.3, level);
  };
  EXPECT_NEAR(at(1.25, 1)[0], (0 + 1 + 0.5 * 2) / 2.5, 1e-12);
  EXPECT_NEAR(at(3.75, 1)[0], (0.5 * 2 + 3 + 4) / 2.5, 1e-12);
  EXPECT_NEAR(at(1.25, 1)[1], 10, 1e-12);
  EXPECT_NEAR(at(2.0, 2)[0], 2, 1e-12);
  EXPECT_NEAR(FilteredInSpace(1, 1, Ramp, 0.7, -3, 5)[2], 0, 0);
}

class FilteredCodec : public ::testing::TestWithParam<const Encoder*> {};

// In all six dimensions: at a measured pair the last level is the mean of the decoded image, level
// 0 at a texel's centre its texel, and elsewhere what Evaluate gives is what is averaged.
TEST_P(FilteredCodec, EvaluatesBetweenTexelsAndOverThem) {
  const btf::SampledBtf btf = btf::SyntheticBtf(
      btf::SmallHeader(6, 4, btf::RingDirections(2, 5, 60), btf::RingDirections(2, 6, 60)));
  const auto encoded = GetParam()->Encode(btf, {});
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  const btf::BtfHeader& h = (*encoded)->info().header;
  std::vector<float> image(h.texel_count() * 3);
  (*encoded)->DecodeImage(4, 7, image);
  std::array<double, 3> mean{};
  double largest = 1e-3;
  for (size_t k = 0; k < image.size(); ++k) {
    mean[k % 3] += static_cast<double>(image[k]) / static_cast<double>(h.texel_count());
    largest = std::max(largest, std::abs(static_cast<double>(image[k])));
  }
  const auto whole = EvaluateFiltered(**encoded, 0.2, 0.9, 9, h.views[4], h.lights[7]);
  const auto texel = EvaluateFiltered(**encoded, 2.5 / 6, 1.5 / 4, 0, h.views[4], h.lights[7]);
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(whole[c], mean[c], 1e-5 * largest);
    EXPECT_NEAR(texel[c], image[(1 * 6 + 2) * 3 + c], 1e-5 * largest);
  }
  const Vec3 v = Normalized(h.views[2] + h.views[3]), l = Normalized(h.lights[5] + h.lights[6]);
  const auto left = (*encoded)->Evaluate(1, 2, v, l), right = (*encoded)->Evaluate(2, 2, v, l);
  const auto between = EvaluateFiltered(**encoded, 1.75 / 6, 2.5 / 4, 0, v, l);
  for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(between[c], 0.75 * left[c] + 0.25 * right[c], 1e-6);
}

INSTANTIATE_TEST_SUITE_P(AllCodecs, FilteredCodec, ::testing::ValuesIn(AllEncoders()), CodecOfTest);

}  // namespace
}  // namespace mesorig::codecs
