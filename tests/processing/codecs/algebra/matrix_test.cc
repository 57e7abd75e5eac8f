#include "processing/codecs/algebra/matrix.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace mesorig::codecs::algebra {
namespace {

template <typename T>
Matrix<T> Random(int64_t rows, int64_t cols, unsigned seed) {
  Matrix<T> m(rows, cols);
  std::mt19937 random(seed);
  std::normal_distribution<T> normal;
  for (T& x : m.values) x = normal(random);
  return m;
}

TEST(Matrix, ProductsAreThoseOfTheDefinition) {
  const MatrixD a = Random<double>(5, 7, 1), b = Random<double>(7, 3, 2);
  const MatrixD c = Multiply(a, false, b, false), d = Multiply(b, true, a, true);
  for (int64_t i = 0; i < 5; ++i) {
    for (int64_t j = 0; j < 3; ++j) {
      double sum = 0;
      for (int64_t k = 0; k < 7; ++k) sum += a(i, k) * b(k, j);
      EXPECT_NEAR(c(i, j), sum, 1e-13);
      EXPECT_NEAR(d(j, i), sum, 1e-13);
    }
  }
}

TEST(Matrix, GramIsTheProductOfAViewWithItself) {
  const MatrixF a = Random<float>(9000, 6, 3);  // more than one block of the conversion
  MatrixD gram(4, 4);
  AddGram(ViewF(a.Column(1) + 10, 8900, 4, a.rows), gram);
  for (int64_t i = 0; i < 4; ++i) {
    for (int64_t j = 0; j < 4; ++j) {
      double sum = 0;
      for (int64_t k = 0; k < 8900; ++k) sum += double{a(10 + k, 1 + i)} * double{a(10 + k, 1 + j)};
      EXPECT_NEAR(gram(i, j), sum, 1e-8);
    }
  }
}

TEST(Matrix, OrthonormaliseHoldsTheSpanAndNeedsNoRank) {
  MatrixF a = Random<float>(300, 6, 4);
  for (int64_t i = 0; i < 300; ++i) {
    a(i, 3) = a(i, 0) - 2 * a(i, 1);  // depends on others
    a(i, 4) = 0;
    a(i, 5) *= 1e-12f;
  }
  const MatrixF before = a;
  MatrixF r;
  ASSERT_TRUE(Orthonormalise(a, &r).ok());
  EXPECT_LT(OrthogonalityError(a), 1e-6);
  const MatrixF back = Multiply(a, false, r, false);
  for (size_t i = 0; i < back.values.size(); ++i) {
    EXPECT_NEAR(back.values[i], before.values[i], 1e-5);
  }
}

TEST(Matrix, EigenvaluesFallAndRebuildTheMatrix) {
  const MatrixD b = Random<double>(20, 8, 5);
  MatrixD a = Multiply(b, true, b, false);
  const MatrixD before = a;
  std::vector<double> values;
  ASSERT_TRUE(SymmetricEigen(a, values).ok());
  EXPECT_TRUE(std::is_sorted(values.rbegin(), values.rend()));
  for (int64_t i = 0; i < 8; ++i) {
    for (int64_t j = 0; j < 8; ++j) {
      double sum = 0;
      for (int64_t k = 0; k < 8; ++k) sum += a(i, k) * values[static_cast<size_t>(k)] * a(j, k);
      EXPECT_NEAR(sum, before(i, j), 1e-11);
    }
  }
}

TEST(Matrix, ThinSvdRebuildsTallAndWide) {
  for (const auto& [rows, cols] : {std::pair<int64_t, int64_t>{12, 5}, {4, 9}, {1, 6}, {6, 1}}) {
    const MatrixD a = Random<double>(rows, cols, 6);
    const auto svd = ThinSvd(a);
    ASSERT_TRUE(svd.ok()) << svd.status();
    for (int64_t i = 0; i < rows; ++i) {
      for (int64_t j = 0; j < cols; ++j) {
        double sum = 0;
        for (int64_t k = 0; k < svd->u.cols; ++k) {
          sum += svd->u(i, k) * svd->sigma[static_cast<size_t>(k)] * svd->v(j, k);
        }
        EXPECT_NEAR(sum, a(i, j), 1e-13);
      }
    }
  }
}

TEST(Matrix, NormalEquationsEvenOfNothing) {
  const MatrixD b = Random<double>(30, 4, 7);
  MatrixD x(4, 2);
  x(1, 0) = 1, x(2, 1) = -3;
  MatrixD right = Multiply(Multiply(b, true, b, false), false, x, false);
  ASSERT_TRUE(SolvePositive(Multiply(b, true, b, false), 1e-14, right).ok());
  for (size_t i = 0; i < x.values.size(); ++i) EXPECT_NEAR(right.values[i], x.values[i], 1e-10);
  MatrixD zero(4, 1);
  ASSERT_TRUE(SolvePositive(MatrixD(4, 4), 1e-14, zero).ok());
  for (const double value : zero.values) EXPECT_EQ(value, 0);
}

}  // namespace
}  // namespace mesorig::codecs::algebra
