#include "simulator/plant/read_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace mesorig::plant {
namespace {

const std::array<uint32_t, 4> kWords = {1, 2, 3, 4};

TEST(ReadNoise, IsNormal) {
  std::vector<float> out(1 << 20);
  FillNormal(kWords, 0, out);
  const auto n = static_cast<double>(out.size());
  double sum = 0, square = 0, cube = 0, fourth = 0, neighbours = 0;
  int within[4] = {};
  for (size_t i = 0; i < out.size(); ++i) {
    const double x = out[i];
    sum += x;
    square += x * x;
    cube += x * x * x;
    fourth += x * x * x * x;
    if (i > 0) neighbours += x * out[i - 1];
    for (int k = 1; k < 4; ++k) within[k] += std::abs(x) < k;
  }
  const double sd = 1 / std::sqrt(n);
  EXPECT_NEAR(sum / n, 0, 4 * sd);
  EXPECT_NEAR(square / n, 1, 4 * std::sqrt(2) * sd);
  EXPECT_NEAR(cube / n, 0, 4 * std::sqrt(15) * sd);
  EXPECT_NEAR(fourth / n, 3, 4 * std::sqrt(96) * sd);
  EXPECT_NEAR(neighbours / n, 0, 4 * sd);
  const double expected[4] = {0, 0.682689, 0.954500, 0.997300};
  for (int k = 1; k < 4; ++k) {
    EXPECT_NEAR(within[k] / n, expected[k], 4 * 0.5 * sd) << k;
  }
}

TEST(ReadNoise, APixelsNumberIsItsOwn) {
  std::vector<float> all(1000);
  FillNormal(kWords, 0, all);
  for (uint32_t first : {0u, 1u, 2u, 3u, 7u, 63u, 64u, 501u}) {
    for (size_t count : {1u, 2u, 5u, 64u, 300u}) {
      std::vector<float> part(count);
      FillNormal(kWords, first, part);
      for (size_t k = 0; k < count; ++k) ASSERT_EQ(part[k], all[first + k]) << first << " " << k;
    }
  }
}

TEST(ReadNoise, OtherWordsOtherNumbers) {
  std::vector<float> a(100), b(100);
  FillNormal(kWords, 0, a);
  for (size_t w = 0; w < 4; ++w) {
    auto words = kWords;
    words[w] ^= 1;
    FillNormal(words, 0, b);
    EXPECT_NE(a, b) << w;
  }
}

}  // namespace
}  // namespace mesorig::plant
