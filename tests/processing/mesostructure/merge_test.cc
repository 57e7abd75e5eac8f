#include "processing/mesostructure/merge.h"

#include <gtest/gtest.h>

#include <vector>

namespace mesorig::mesostructure {
namespace {

struct Vote {
  float distance, weight;
};

// One texel seen by several sweeps; pitch 0.6 mm: what is 0.3 mm apart agrees.
Vote Merged(const std::vector<Vote>& votes) {
  btf::MdfHeader header;
  header.width = header.height = 1, header.pitch_mm = 0.6, header.h_ref_mm = 4;
  header.views = {{0, 0, 1}};
  std::vector<btf::Mdf> images;
  for (const Vote& vote : votes) {
    images.emplace_back(header);
    images.back().MutableDistance(0)[0] = vote.distance;
    images.back().MutableConfidence(0)[0] = vote.weight;
  }
  float distance = -1, confidence = -1;
  MergeImages(images, {&distance, 1}, {&confidence, 1});
  return {distance, confidence};
}

TEST(Merge, WeightedMeanOfWhatAgrees) {
  const Vote merged = Merged({{1.0f, 0.6f}, {1.2f, 0.2f}});
  EXPECT_NEAR(merged.distance, 1.05, 1e-6);
  EXPECT_NEAR(merged.weight, 0.8, 1e-6);
}

TEST(Merge, TwoOutvoteAThirdAndADepthStepIsNeverAveraged) {
  Vote merged = Merged({{3.0f, 0.5f}, {1.0f, 0.4f}, {1.1f, 0.4f}});
  EXPECT_NEAR(merged.distance, 1.05, 1e-6);
  EXPECT_NEAR(merged.weight, 0.8 * 0.8 / 1.3, 1e-6);
  merged = Merged({{1.0f, 0.3f}, {3.0f, 0.5f}});
  EXPECT_EQ(merged.distance, 3.0f);
  EXPECT_NEAR(merged.weight, 0.25 / 0.8, 1e-6);
}

TEST(Merge, NothingSeenIsNothing) {
  EXPECT_EQ(Merged({}).weight, 0);
  const Vote merged = Merged({{7.0f, 0.0f}});
  EXPECT_EQ(merged.distance, 0);
  EXPECT_EQ(merged.weight, 0);
  EXPECT_EQ(Merged({{7.0f, 0.0f}, {2.0f, 0.1f}}).distance, 2.0f);
}

TEST(FillHoles, SmoothAndWithoutTouchingWhatWasMeasured) {
  constexpr int kWidth = 21, kHeight = 17;
  std::vector<float> distance, confidence;
  for (int j = 0; j < kHeight; ++j) {
    for (int i = 0; i < kWidth; ++i) {
      const bool hole = (i > 6 && i < 14 && j > 5 && j < 12) || (i == 0 && j == 0);
      distance.push_back(hole ? 0.0f
                              : 1 + 0.1f * static_cast<float>(i) - 0.02f * static_cast<float>(j));
      confidence.push_back(hole ? 0.0f : 1.0f);
    }
  }
  const auto before = distance;
  ASSERT_TRUE(FillHoles(kWidth, kHeight, distance, confidence));
  for (int j = 0; j < kHeight; ++j) {
    for (int i = 0; i < kWidth; ++i) {
      const auto at = static_cast<size_t>(j * kWidth + i);
      if (confidence[at] > 0) {
        EXPECT_EQ(distance[at], before[at]);
      } else {  // a plane solves Laplace's equation
        EXPECT_NEAR(distance[at], 1 + 0.1 * i - 0.02 * j, 0.12) << i << "," << j;
      }
    }
  }
}

TEST(FillHoles, OneTexelFillsAllAndNoneFillsNothing) {
  std::vector<float> distance(35), confidence(35);
  EXPECT_FALSE(FillHoles(7, 5, distance, confidence));
  distance[3] = 2.5f, confidence[3] = 0.1f;
  ASSERT_TRUE(FillHoles(7, 5, distance, confidence));
  for (const float d : distance) EXPECT_NEAR(d, 2.5, 1e-5);
}

}  // namespace
}  // namespace mesorig::mesostructure
