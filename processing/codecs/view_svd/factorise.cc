#include "processing/codecs/view_svd/factorise.h"

#include <algorithm>
#include <cmath>

namespace mesorig::codecs::view_svd {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kRidge = 1e-9;  // relative to E^T E = 1: only for views that cannot tell terms apart
constexpr int kMaxIterations = 200;
constexpr double kStandsStill = 1e-7;

MatrixXd Rows(const MatrixXd& e, const std::vector<int>& views) {
  MatrixXd rows(static_cast<Eigen::Index>(views.size()), e.cols());
  for (size_t i = 0; i < views.size(); ++i) {
    rows.row(static_cast<Eigen::Index>(i)) = e.row(views[i]);
  }
  return rows;
}

// The leading eigenvectors of a symmetric matrix, strongest first.
MatrixXd Leading(const MatrixXd& symmetric, int terms) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(symmetric);
  return solver.eigenvectors().rowwise().reverse().leftCols(terms);
}

// Sums the groups' Gram matrices; entries that few lights know are scaled up to all of them.
MatrixXd PairwiseGram(const std::vector<LightGroup>& groups, int views) {
  MatrixXd sum = MatrixXd::Zero(views, views), seen = MatrixXd::Zero(views, views);
  double lights = 0;
  for (const LightGroup& group : groups) {
    const auto count = static_cast<double>(group.lights.size());
    lights += count;
    for (size_t i = 0; i < group.views.size(); ++i) {
      for (size_t j = 0; j < group.views.size(); ++j) {
        const auto row = static_cast<Eigen::Index>(i), column = static_cast<Eigen::Index>(j);
        sum(group.views[i], group.views[j]) += group.gram(row, column);
        seen(group.views[i], group.views[j]) += count;
      }
    }
  }
  return (seen.array() > 0).select(sum.array() * lights / seen.array().max(1.0), 0.0);
}

// One round: E from the normal equations that G(E) gives; returns ||M - G E^T||^2 before it.
double Improve(const std::vector<LightGroup>& groups, MatrixXd& e) {
  const Eigen::Index terms = e.cols();
  std::vector<MatrixXd> left(static_cast<size_t>(e.rows()), MatrixXd::Zero(terms, terms));
  MatrixXd right = MatrixXd::Zero(terms, e.rows());
  double residual = 0;
  for (const LightGroup& group : groups) {
    const MatrixXd a = OnPresent(e, group.views), es = Rows(e, group.views);
    const MatrixXd cross = a.transpose() * group.gram;  // G^T M
    const MatrixXd gg = cross * a;                      // G^T G
    residual += group.gram.trace() - 2 * (cross * es).trace() + (es * gg * es.transpose()).trace();
    for (size_t i = 0; i < group.views.size(); ++i) {
      left[static_cast<size_t>(group.views[i])] += gg;
      right.col(group.views[i]) += cross.col(static_cast<Eigen::Index>(i));
    }
  }
  for (Eigen::Index v = 0; v < e.rows(); ++v) {
    MatrixXd& normal = left[static_cast<size_t>(v)];
    const double ridge = kRidge * normal.trace();
    if (ridge <= 0) continue;  // a view that no light knows keeps what it has
    normal.diagonal().array() += ridge;
    e.row(v) = normal.ldlt().solve(right.col(v)).transpose();
  }
  const Eigen::HouseholderQR<MatrixXd> qr(e);
  e = qr.householderQ() * MatrixXd::Identity(e.rows(), terms);
  return residual;
}

// Turns E so that its first column carries the most energy.
void OrderByEnergy(const std::vector<LightGroup>& groups, MatrixXd& e) {
  MatrixXd energy = MatrixXd::Zero(e.cols(), e.cols());
  for (const LightGroup& group : groups) {
    const MatrixXd a = OnPresent(e, group.views);
    energy += a.transpose() * group.gram * a;
  }
  e = e * Leading(0.5 * (energy + energy.transpose()), static_cast<int>(e.cols()));
}

}  // namespace

MatrixXd OnPresent(const MatrixXd& e, const std::vector<int>& views) {
  const MatrixXd es = Rows(e, views);
  MatrixXd normal = es.transpose() * es;
  normal.diagonal().array() += kRidge;
  return normal.ldlt().solve(es.transpose()).transpose();
}

MatrixXd Factorise(const std::vector<LightGroup>& groups, int views, int terms) {
  MatrixXd e = Leading(PairwiseGram(groups, views), terms);
  const bool all_present = groups.size() == 1 && static_cast<int>(groups[0].views.size()) == views;
  if (all_present || terms == views) return e;
  double before = Improve(groups, e);
  for (int i = 0; i < kMaxIterations; ++i) {
    const double now = Improve(groups, e);
    if (std::abs(before - now) <= kStandsStill * std::abs(before)) break;
    before = now;
  }
  OrderByEnergy(groups, e);
  return e;
}

}  // namespace mesorig::codecs::view_svd
