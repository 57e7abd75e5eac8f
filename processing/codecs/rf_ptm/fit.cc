#include "processing/codecs/rf_ptm/fit.h"

#include <algorithm>
#include <cmath>

#include "processing/codecs/rf_ptm/rf_ptm.h"

namespace mesorig::codecs::rf_ptm {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kTiny = 1e-7;       // of the Lambert part; relative to one light
constexpr double kNoise = 1e-4;      // of the mean square: quantisation, no light is exact
constexpr double kMinFreedom = 0.05;  // 1 - leverage of a light that stands alone
constexpr int kIterations = 10;
constexpr double kMinRadius = 0.25;

Eigen::Index Size(const std::vector<Vec3>& lights) {
  return static_cast<Eigen::Index>(lights.size());
}

// lz ~ c0 + c1 r^2 over the cone that holds the lights, by least squares over its area.
std::array<double, 2> ConeOfLz(const std::vector<Vec3>& lights) {
  double radius = kMinRadius;
  for (const Vec3& l : lights) radius = std::max(radius, std::min(1.0, std::hypot(l.x, l.y)));
  constexpr int kRings = 64;  // of equal area
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (int i = 0; i < kRings; ++i) {
    const double x = radius * radius * (i + 0.5) / kRings, y = std::sqrt(std::max(0.0, 1 - x));
    n += 1, sx += x, sy += y, sxx += x * x, sxy += x * y;
  }
  const double c1 = (n * sxy - sx * sy) / (n * sxx - sx * sx);
  return {(sy - c1 * sx) / n, c1};
}

// Columns: Lambert's lx, ly, lz as polynomials, then the curvatures; in coefficients a0..a5.
MatrixXd LambertFirst(const std::vector<Vec3>& lights) {
  const auto [c0, c1] = ConeOfLz(lights);
  MatrixXd t = MatrixXd::Zero(kCoefficients, kCoefficients);
  t(3, 0) = 1;
  t(4, 1) = 1;
  t(0, 2) = c1;
  t(1, 2) = c1;
  t(5, 2) = c0;
  t(0, 3) = 1;
  t(1, 4) = 1;
  t(2, 5) = 1;
  return t;
}

}  // namespace

MatrixXd FitOperator(const std::vector<Vec3>& lights, const VectorXd& weights,
                     double regularisation) {
  MatrixXd basis(Size(lights), kCoefficients);
  for (Eigen::Index i = 0; i < basis.rows(); ++i) {
    const auto row = Basis(lights[static_cast<size_t>(i)]);
    for (int a = 0; a < kCoefficients; ++a) basis(i, a) = row[static_cast<size_t>(a)];
  }
  const MatrixXd t = LambertFirst(lights);
  const VectorXd root = weights.cwiseSqrt();
  // Stacked, not as normal equations: the lights may lie so close that their squares say nothing.
  MatrixXd stacked = MatrixXd::Zero(basis.rows() + kCoefficients, kCoefficients);
  stacked.topRows(basis.rows()) = root.asDiagonal() * basis * t;
  for (int a = 0; a < kCoefficients; ++a) {
    stacked(basis.rows() + a, a) = std::sqrt(a < 3 ? kTiny : std::max(regularisation, kTiny * kTiny));
  }
  MatrixXd right = MatrixXd::Zero(stacked.rows(), basis.rows());
  right.topRows(basis.rows()) = root.asDiagonal();
  return t * stacked.colPivHouseholderQr().solve(right);
}

VectorXd LightWeights(const std::vector<Vec3>& lights, const MatrixXd& gram) {
  const Eigen::Index n = Size(lights);
  VectorXd weights = VectorXd::Ones(n);
  const double mean_square = gram.trace() / static_cast<double>(n);
  if (n < 5 || !(mean_square > 0)) return weights;
  MatrixXd l(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Vec3& light = lights[static_cast<size_t>(i)];
    l.row(i) << light.x, light.y, light.z;
  }
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    MatrixXd normal = l.transpose() * weights.asDiagonal() * l;
    normal.diagonal().array() += kTiny;
    const MatrixXd hat = l * normal.ldlt().solve(l.transpose() * MatrixXd(weights.asDiagonal()));
    const MatrixXd rest = MatrixXd::Identity(n, n) - hat;
    const VectorXd squares = (rest * gram * rest.transpose()).diagonal();
    for (Eigen::Index i = 0; i < n; ++i) {
      const double variance =
          std::max(0.0, squares[i]) / std::max(kMinFreedom, 1 - hat(i, i));
      weights[i] = 1 / (variance + kNoise * mean_square);
    }
    weights *= static_cast<double>(n) / weights.sum();
  }
  return weights;
}

}  // namespace mesorig::codecs::rf_ptm
