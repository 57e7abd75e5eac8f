#include "processing/codecs/algebra/truncated_svd.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

namespace mesorig::codecs::algebra {
namespace {

MatrixF Gaussian(int64_t rows, int64_t cols, unsigned seed) {
  MatrixF m(rows, cols);
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  for (float& x : m.values) x = normal(random);
  return m;
}

// A matrix with those singular values.
MatrixF WithSpectrum(int64_t rows, int64_t cols, const std::function<double(int64_t)>& sigma) {
  const int64_t k = std::min(rows, cols);
  MatrixF u = Gaussian(rows, k, 1), v = Gaussian(cols, k, 2);
  EXPECT_TRUE(Orthonormalise(u).ok() && Orthonormalise(v).ok());
  for (int64_t j = 0; j < k; ++j) {
    for (int64_t i = 0; i < rows; ++i) u(i, j) *= static_cast<float>(sigma(j));
  }
  return Multiply(u, false, v, true);
}

std::vector<double> SingularValues(const MatrixF& a) {
  MatrixD wide(a.rows, a.cols);
  std::copy(a.values.begin(), a.values.end(), wide.values.begin());
  return ThinSvd(std::move(wide))->sigma;
}

double Norm(const MatrixF& a) {
  double square = 0;
  for (const float x : a.values) square += double{x} * double{x};
  return std::sqrt(square);
}

// ||A - U sigma V^T||, computed as it is written, with the first `rank` terms.
double Error(const MatrixF& a, const TruncatedSvd& svd, int64_t rank) {
  MatrixD u(a.rows, rank), v(a.cols, rank);
  for (int64_t k = 0; k < rank; ++k) {
    for (int64_t i = 0; i < a.rows; ++i) u(i, k) = svd.u(i, k) * svd.sigma[static_cast<size_t>(k)];
    for (int64_t i = 0; i < a.cols; ++i) v(i, k) = svd.v(i, k);
  }
  const MatrixD product = Multiply(u, false, v, true);
  double square = 0;
  for (size_t i = 0; i < a.values.size(); ++i) {
    square += std::pow(a.values[i] - product.values[i], 2);
  }
  return std::sqrt(square);
}

double Tail(const std::vector<double>& sigma, int64_t from) {
  double square = 0;
  for (size_t k = static_cast<size_t>(from); k < sigma.size(); ++k) square += sigma[k] * sigma[k];
  return std::sqrt(square);
}

SvdOptions Options(int64_t rank, SvdMethod method = SvdMethod::kAutomatic) {
  SvdOptions options;
  options.rank = rank;
  options.method = method;
  options.block_bytes = 20000;  // several blocks even of small matrices
  return options;
}

TruncatedSvd Decomposed(const MatrixF& a, const SvdOptions& options) {
  auto svd = DecomposeTruncated(DenseSource(a), options);
  EXPECT_TRUE(svd.ok()) << svd.status();
  return svd.ok() ? *std::move(svd) : TruncatedSvd();
}

constexpr SvdMethod kMethods[] = {SvdMethod::kDirect, SvdMethod::kGram, SvdMethod::kRandomised};

std::string NameOf(SvdMethod method) {
  constexpr const char* kNames[] = {"Automatic", "Direct", "Gram", "Randomised"};
  return kNames[static_cast<int>(method)];
}

class EveryMethod : public ::testing::TestWithParam<SvdMethod> {};

// Eckart and Young: no matrix of that rank is nearer than the tail of the singular values.
TEST_P(EveryMethod, IsWithinOnePercentOfOptimalAtEveryRank) {
  const std::pair<const char*, std::function<double(int64_t)>> spectra[] = {
      {"geometric", [](int64_t k) { return std::pow(0.7, k); }},
      {"harmonic", [](int64_t k) { return 1.0 / static_cast<double>(1 + k); }},
      {"flat", [](int64_t) { return 1.0; }},
      {"step", [](int64_t k) { return k < 7 ? 1.0 : 1e-3; }},
      {"outlier", [](int64_t k) { return k == 0 ? 1000.0 : 1.0 / static_cast<double>(k); }},
  };
  for (const auto& [name, spectrum] : spectra) {
    for (const auto& [rows, cols] : {std::pair<int64_t, int64_t>{90, 40}, {40, 90}}) {
      const MatrixF a = WithSpectrum(rows, cols, spectrum);
      const std::vector<double> sigma = SingularValues(a);
      double worst = 0;
      for (int64_t rank = 1; rank <= 40; ++rank) {
        const TruncatedSvd svd = Decomposed(a, Options(rank, GetParam()));
        const double best = Tail(sigma, rank), error = Error(a, svd, rank);
        EXPECT_LE(error, 1.01 * best + 1e-6 * svd.norm) << name << ", rank " << rank;
        if (best > 1e-4 * svd.norm) worst = std::max(worst, error / best - 1);
        EXPECT_NEAR(svd.residual, error / svd.norm, 1e-3);
        EXPECT_LT(OrthogonalityError(svd.u), 1e-6);
        EXPECT_LT(OrthogonalityError(svd.v), 1e-6);
      }
      RecordProperty(std::string(name) + (rows > cols ? "_tall" : "_wide"), std::to_string(worst));
    }
  }
}

TEST_P(EveryMethod, FactorsAreOrthonormalAtConditionNumber1e12) {
  const MatrixF a = WithSpectrum(400, 60, [](int64_t k) { return std::pow(10, -0.2 * static_cast<double>(k)); });
  MatrixF graded = Gaussian(400, 60, 5);  // columns of falling size: float holds their digits
  for (int64_t j = 0; j < 60; ++j) {
    for (int64_t i = 0; i < 400; ++i) graded(i, j) *= static_cast<float>(std::pow(10, -0.2 * static_cast<double>(j)));
  }
  for (const MatrixF* m : {&a, static_cast<const MatrixF*>(&graded)}) {
    for (const int64_t rank : {8, 30, 60}) {
      const TruncatedSvd svd = Decomposed(*m, Options(rank, GetParam()));
      EXPECT_LT(OrthogonalityError(svd.u), 1e-6) << rank;
      EXPECT_LT(OrthogonalityError(svd.v), 1e-6) << rank;
      EXPECT_TRUE(std::is_sorted(svd.sigma.rbegin(), svd.sigma.rend()));
    }
  }
}

TEST_P(EveryMethod, DegenerateMatrices) {
  const MatrixF rank3 = WithSpectrum(50, 30, [](int64_t k) { return k < 3 ? 2.0 : 0.0; });
  EXPECT_LT(Error(rank3, Decomposed(rank3, Options(3, GetParam())), 3), 1e-5);
  EXPECT_LT(Error(rank3, Decomposed(rank3, Options(20, GetParam())), 20), 1e-5);
  const MatrixF zero(50, 30);
  const TruncatedSvd nothing = Decomposed(zero, Options(4, GetParam()));
  EXPECT_EQ(nothing.norm, 0);
  EXPECT_EQ(nothing.residual, 0);
  for (const double s : nothing.sigma) EXPECT_EQ(s, 0);
  EXPECT_LT(OrthogonalityError(nothing.u), 1e-6);
  EXPECT_LT(OrthogonalityError(nothing.v), 1e-6);
  MatrixF constant(50, 30);
  for (float& x : constant.values) x = 0.25f;
  const TruncatedSvd one = Decomposed(constant, Options(2, GetParam()));
  EXPECT_NEAR(one.sigma[0], 0.25 * std::sqrt(1500.0), 1e-5);
  EXPECT_NEAR(one.sigma[1], 0, 1e-5);
  EXPECT_LT(Error(constant, one, 1), 1e-5);
  for (const auto& [rows, cols] : {std::pair<int64_t, int64_t>{1, 30}, {30, 1}, {1, 1}, {2, 30}}) {
    const MatrixF thin = Gaussian(rows, cols, 6);
    const TruncatedSvd svd = Decomposed(thin, Options(5, GetParam()));
    EXPECT_EQ(svd.u.cols, std::min<int64_t>({5, rows, cols}));
    EXPECT_LT(Error(thin, svd, svd.u.cols), 1e-5);
  }
}

TEST_P(EveryMethod, ScaleDoesNotMatter) {
  for (const double scale : {1e-30, 1e30}) {
    const MatrixF a = WithSpectrum(80, 40, [&](int64_t k) { return scale * std::pow(0.8, k); });
    const TruncatedSvd svd = Decomposed(a, Options(10, GetParam()));
    EXPECT_LE(Error(a, svd, 10), 1.01 * Tail(SingularValues(a), 10));
    EXPECT_NEAR(svd.norm / Norm(a), 1, 1e-6);
  }
}

TEST_P(EveryMethod, WhatIsNotFiniteIsRefusedWithItsPlace) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(),
                          -std::numeric_limits<float>::infinity()}) {
    MatrixF a = Gaussian(300, 40, 7);
    a(211, 17) = bad;
    const auto svd = DecomposeTruncated(DenseSource(a), Options(4, GetParam()));
    ASSERT_EQ(svd.status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(Message(svd.status())), ::testing::HasSubstr("row 211, column 17"));
  }
}

TEST_P(EveryMethod, OneThreadAndTwoAgree) {
  const MatrixF a = WithSpectrum(600, 300, [](int64_t k) { return std::pow(0.9, k); });
  const int before = Threads();
  SetThreads(1);
  const TruncatedSvd one = Decomposed(a, Options(12, GetParam()));
  SetThreads(2);
  const TruncatedSvd two = Decomposed(a, Options(12, GetParam()));
  SetThreads(before);
  for (size_t k = 0; k < 12; ++k) EXPECT_NEAR(one.sigma[k], two.sigma[k], 1e-5 * one.sigma[0]);
  for (int64_t i = 0; i < a.rows; i += 7) {  // signs may differ, products may not
    for (int64_t j = 0; j < a.cols; j += 5) {
      double x = 0, y = 0;
      for (int64_t k = 0; k < 12; ++k) {
        x += one.u(i, k) * one.sigma[static_cast<size_t>(k)] * one.v(j, k);
        y += two.u(i, k) * two.sigma[static_cast<size_t>(k)] * two.v(j, k);
      }
      EXPECT_NEAR(x, y, 1e-5);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(TruncatedSvd, EveryMethod, ::testing::ValuesIn(kMethods),
                         [](const auto& parameter) { return NameOf(parameter.param); });

// Remembers how much was asked for at a time.
class Watched final : public RowSource {
 public:
  explicit Watched(const MatrixF& m) : dense_(m) {}
  int64_t rows() const override { return dense_.rows(); }
  int64_t cols() const override { return dense_.cols(); }
  StatusOr<ViewF> Rows(int64_t first, int64_t count, float* scratch) const override {
    for (int64_t seen = largest_; seen < count && !largest_.compare_exchange_weak(seen, count);) {
    }
    return dense_.Rows(first, count, scratch);
  }
  int64_t largest() const { return largest_; }

 private:
  DenseSource dense_;
  mutable std::atomic<int64_t> largest_ = 0;
};

TEST(TruncatedSvd, ReadsBlocksNeverTheWhole) {
  const MatrixF a = WithSpectrum(3000, 500, [](int64_t k) { return std::pow(0.8, k); });
  const Watched source(a);
  SvdOptions options = Options(8, SvdMethod::kRandomised);
  options.block_bytes = 100 * 500 * 4;
  const auto svd = DecomposeTruncated(source, options);
  ASSERT_TRUE(svd.ok()) << svd.status();
  EXPECT_EQ(svd->method, SvdMethod::kRandomised);
  EXPECT_EQ(source.largest(), 100);
  EXPECT_LE(Error(a, *svd, 8), 1.01 * Tail(SingularValues(a), 8));
}

// A large matrix is sketched by signed sums; one row that is like no other is found all the same.
TEST(TruncatedSvd, SketchesLargeMatrices) {
  MatrixF a = WithSpectrum(9000, 300, [](int64_t k) { return 1.0 / static_cast<double>(1 + k); });
  for (int64_t j = 0; j < a.cols; ++j) a(77, j) = j == 5 ? 0.8f : 0.0f;
  SvdOptions options = Options(4, SvdMethod::kRandomised);
  options.block_bytes = 1 << 20;
  const TruncatedSvd svd = Decomposed(a, options);
  EXPECT_LE(Error(a, svd, 4), 1.001 * Tail(SingularValues(a), 4));
  EXPECT_LT(OrthogonalityError(svd.v), 1e-6);
}

TEST(TruncatedSvd, PowerStepsEndWhenTheResidualStandsStill) {
  const MatrixF easy = WithSpectrum(400, 300, [](int64_t k) { return k < 5 ? 1.0 : 1e-3; });
  const MatrixF hard = WithSpectrum(400, 300, [](int64_t k) { return std::pow(0.99, k); });
  const TruncatedSvd quick = Decomposed(easy, Options(5, SvdMethod::kRandomised));
  const TruncatedSvd slow = Decomposed(hard, Options(5, SvdMethod::kRandomised));
  EXPECT_LE(quick.power_steps, 3);
  EXPECT_LE(slow.power_steps, 8);
  SvdOptions all = Options(5, SvdMethod::kRandomised);
  all.stop = -1;
  EXPECT_EQ(Decomposed(hard, all).power_steps, 8);
  EXPECT_LE(Error(hard, slow, 5), 1.01 * Tail(SingularValues(hard), 5));
}

TEST(TruncatedSvd, Refuses) {
  const MatrixF a(3, 3);
  EXPECT_FALSE(DecomposeTruncated(DenseSource(a), Options(0)).ok());
  EXPECT_FALSE(DecomposeTruncated(DenseSource(MatrixF(0, 3)), Options(1)).ok());
}

}  // namespace
}  // namespace mesorig::codecs::algebra
