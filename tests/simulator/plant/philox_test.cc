#include "simulator/plant/philox.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace mesorig::plant {
namespace {

// Known answers published with Random123 (kat_vectors, philox4x32 10).
TEST(Philox, KnownAnswers) {
  EXPECT_EQ(Philox4x32({0, 0, 0, 0}, {0, 0}),
            (PhiloxCounter{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}));
  EXPECT_EQ(Philox4x32({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}),
            (PhiloxCounter{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}));
  EXPECT_EQ(Philox4x32({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}),
            (PhiloxCounter{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}));
}

TEST(Philox, UniformLiesInRange) {
  PhiloxStream random({1, 2}, 3, 4, 5);
  double sum = 0;
  for (int i = 0; i < 100000; ++i) {
    const double u = random.Uniform();
    ASSERT_TRUE(u >= 0 && u < 1);
    sum += u;
  }
  EXPECT_NEAR(sum / 100000, 0.5, 5 * std::sqrt(1 / 12.0 / 100000));
}

TEST(Philox, GaussianMoments) {
  PhiloxStream random({7, 7}, 0, 0, 0);
  const int n = 200000;
  double m1 = 0, m2 = 0, m4 = 0;
  for (int i = 0; i < n; ++i) {
    const double g = random.Gaussian();
    m1 += g, m2 += g * g, m4 += g * g * g * g;
  }
  EXPECT_NEAR(m1 / n, 0, 5 / std::sqrt(n));
  EXPECT_NEAR(m2 / n, 1, 5 * std::sqrt(2.0 / n));
  EXPECT_NEAR(m4 / n, 3, 5 * std::sqrt(96.0 / n));
}

// Mean, variance and the whole distribution (chi square over its middle) on both sides of the
// change of method at 10.
TEST(Philox, PoissonIsPoisson) {
  for (double mean : {0.01, 0.7, 5.0, 9.99, 10.01, 30.0, 400.0}) {
    PhiloxStream random({42, static_cast<uint32_t>(1000 * mean)}, 0, 0, 0);
    const int n = 100000;
    std::vector<double> histogram(static_cast<size_t>(mean + 12 * std::sqrt(mean) + 20));
    double m1 = 0, m2 = 0;
    for (int i = 0; i < n; ++i) {
      const int64_t k = random.Poisson(mean);
      ASSERT_GE(k, 0);
      ASSERT_LT(k, static_cast<int64_t>(histogram.size()));
      ++histogram[static_cast<size_t>(k)];
      m1 += static_cast<double>(k), m2 += static_cast<double>(k) * static_cast<double>(k);
    }
    m1 /= n, m2 = m2 / n - m1 * m1;
    EXPECT_NEAR(m1, mean, 5 * std::sqrt(mean / n)) << mean;
    EXPECT_NEAR(m2, mean, 5 * std::sqrt((mean + 2 * mean * mean) / n)) << mean;
    double chi2 = 0;
    int bins = 0;
    for (size_t k = 0; k < histogram.size(); ++k) {
      const double kd = static_cast<double>(k);
      const double expected = n * std::exp(kd * std::log(mean) - mean - std::lgamma(kd + 1));
      if (expected < 10) continue;
      chi2 += (histogram[k] - expected) * (histogram[k] - expected) / expected;
      ++bins;
    }
    EXPECT_LT(chi2, bins + 5 * std::sqrt(2.0 * bins)) << mean;
  }
}

TEST(Philox, PoissonOfHugeAndOfNoMeans) {
  PhiloxStream random({1, 1}, 0, 0, 0);
  EXPECT_NEAR(static_cast<double>(random.Poisson(1e9)), 1e9, 6 * std::sqrt(1e9));
  EXPECT_EQ(random.Poisson(0), 0);
  EXPECT_EQ(random.Poisson(-1), 0);
  EXPECT_EQ(random.Poisson(std::nan("")), 0);
}

}  // namespace
}  // namespace mesorig::plant
