#include <algorithm>
#include <cmath>

#include "processing/codecs/algebra/svd_sketch.h"

namespace mesorig::codecs::algebra {
namespace {

constexpr double kOrthogonal = 1e-6;
constexpr int64_t kBasisBytes = int64_t{256} << 20;  // of a basis that grows, and its products

double Residual(double square, const std::vector<double>& sigma) {
  double rest = square;
  for (const double s : sigma) rest -= s * s;
  return square > 0 ? std::sqrt(std::max(0.0, rest) / square) : 0;
}

}  // namespace

StatusOr<TruncatedSvd> Sketch::Randomised() {
  MESORIG_RETURN_IF_ERROR(Start([this] { return First(); }));
  MESORIG_RETURN_IF_ERROR(PowerSteps(options_.max_power_steps));
  return Finish(SvdMethod::kRandomised);
}

StatusOr<TruncatedSvd> Sketch::Gram() {
  bool visible = true;
  MESORIG_RETURN_IF_ERROR(Start([&] { return Eigenvectors(visible); }));
  if (!visible) MESORIG_RETURN_IF_ERROR(PowerSteps(std::max(options_.max_power_steps, 2)));
  return Finish(SvdMethod::kGram);
}

int64_t Sketch::MostBlocks(int steps) const {
  const int64_t side = std::min(source_.rows(), source_.cols()) / width_;
  const int64_t bytes = 4 * width_ * (source_.rows() + source_.cols());
  return std::clamp<int64_t>(std::min(side, kBasisBytes / bytes), 1, steps + 1);
}

Status Sketch::PowerSteps(int steps) {
  const int64_t most = MostBlocks(steps);
  if (most == 1) return PlainPowerSteps(steps);
  for (int step = 0; step < std::min<int64_t>(steps, most - 1); ++step) {
    MatrixF next, z;
    MESORIG_RETURN_IF_ERROR(MultiplyNewest(z, &next));
    AddProducts(z);
    ++power_steps_;
    MESORIG_ASSIGN_OR_RETURN(const double gain, Gain(next));
    MESORIG_RETURN_IF_ERROR(Extend(std::move(next)));
    // What this step has found lowers residual^2 by about `gain`; what another one would find, by
    // less than its square (the gaps that both see are the same), residual by half of that.
    if (gain * gain <= 2 * options_.stop) break;
  }
  return OkStatus();
}

StatusOr<double> Sketch::Gain(const MatrixF& next) {
  MatrixD vectors = gram_;
  std::vector<double> energies;
  MESORIG_RETURN_IF_ERROR(SymmetricEigen(vectors, energies));
  MatrixF outside = next;
  MatrixF known = Multiply(q_, true, next, false);
  for (float& x : known.values) x = -x;
  MultiplyInto(q_, false, known, false, 1.0f, outside.values.data(), outside.rows);
  MatrixF coefficients(next.cols, rank_);  // of the Ritz vectors in the newest block
  for (int64_t k = 0; k < rank_; ++k) {
    for (int64_t i = 0; i < next.cols; ++i) {
      coefficients(i, k) = static_cast<float>(vectors(vectors.rows - next.cols + i, k));
    }
  }
  const MatrixF rest = Multiply(outside, false, coefficients, false);
  double gain = 0, left = reading_.square;
  for (int64_t k = 0; k < rank_; ++k) {
    double square = 0;
    for (int64_t i = 0; i < rest.rows; ++i) square += std::pow(static_cast<double>(rest(i, k)), 2);
    const double lambda = energies[static_cast<size_t>(k)], gap = lambda - energies.back();
    gain += std::min(square / std::max(gap, 1e-3 * lambda + 1e-300), lambda);
    left -= lambda;
  }
  return left > 1e-12 * reading_.square ? gain / left : 0.0;
}

Status Sketch::PlainPowerSteps(int steps) {
  double before = 0;
  for (int step = 0; step < steps; ++step) {
    MatrixF next, z;
    MESORIG_RETURN_IF_ERROR(MultiplyNewest(z, &next));
    MatrixD gram(z.cols, z.cols);
    AddGram(z, gram);
    std::vector<double> energies;
    MESORIG_RETURN_IF_ERROR(SymmetricEigen(gram, energies));
    double captured = 0;
    for (int64_t k = 0; k < rank_; ++k) captured += energies[static_cast<size_t>(k)];
    q_ = std::move(next);
    MESORIG_RETURN_IF_ERROR(Orthonormalise(q_));
    ++power_steps_;
    // residual^2 falls by about twice the fraction by which the residual does.
    const double residual = std::max(0.0, reading_.square - captured);
    if (step > 0 && captured - before <= 2 * options_.stop * residual) break;
    before = captured;
  }
  return OkStatus();
}

Status Sketch::MultiplyNewest(MatrixF& z, MatrixF* next) {
  const ViewF newest = Newest();
  z = MatrixF(source_.rows(), newest.cols);
  Sums<float> sums(next == nullptr ? 0 : blocks_.workers(), q_.rows, newest.cols);
  MESORIG_RETURN_IF_ERROR(blocks_.ForEach([&](int worker, int64_t first, ViewF block) {
    MultiplyInto(block, false, newest, false, 0.0f, z.values.data() + first, z.rows);
    if (next == nullptr) return OkStatus();
    MatrixF& sum = sums.of(worker);
    MultiplyInto(block, true, {z.values.data() + first, block.rows, z.cols, z.rows}, false, 1.0f,
                 sum.values.data(), sum.rows);
    return OkStatus();
  }));
  if (next != nullptr) *next = sums.Total();
  return OkStatus();
}

void Sketch::AddProducts(const MatrixF& z) {
  b_.rows = z.rows;
  b_.cols += z.cols;
  b_.values.insert(b_.values.end(), z.values.begin(), z.values.end());
  MatrixD cross(b_.cols, z.cols);
  AddProduct(b_, z, cross);
  MatrixD gram(b_.cols, b_.cols);
  for (int64_t j = 0; j < gram_.cols; ++j) std::copy_n(gram_.Column(j), gram_.rows, gram.Column(j));
  for (int64_t j = 0; j < z.cols; ++j) {
    for (int64_t i = 0; i < b_.cols; ++i) {
      gram(i, gram_.cols + j) = gram(gram_.cols + j, i) = cross(i, j);
    }
  }
  gram_ = std::move(gram);
}

Status Sketch::Extend(MatrixF next) {
  for (int round = 0; round < 2 && q_.cols > 0; ++round) {
    MatrixF known = Multiply(q_, true, next, false);
    for (float& x : known.values) x = -x;
    MultiplyInto(q_, false, known, false, 1.0f, next.values.data(), next.rows);
    MESORIG_RETURN_IF_ERROR(Orthonormalise(next));
  }
  if (q_.cols == 0) MESORIG_RETURN_IF_ERROR(Orthonormalise(next));
  const int64_t known = q_.cols;
  MatrixD cross(known, next.cols);
  if (known > 0) AddProduct(q_, next, cross);
  q_.rows = next.rows;
  q_.cols += next.cols;
  q_.values.insert(q_.values.end(), next.values.begin(), next.values.end());
  if (std::all_of(cross.values.begin(), cross.values.end(),
                  [](double x) { return std::abs(x) < kOrthogonal; })) {
    return OkStatus();
  }
  return Straighten(q_);
}

Status Sketch::Straighten(MatrixF& q) {
  MatrixF r;
  MESORIG_RETURN_IF_ERROR(Orthonormalise(q, &r));
  for (int64_t j = 0; j < q.cols; ++j) {
    if (r(j, j) > 0) continue;
    for (int64_t i = 0; i < q.rows; ++i) q(i, j) = -q(i, j);
  }
  return OkStatus();
}

StatusOr<TruncatedSvd> Sketch::Finish(SvdMethod method) {
  if (Newest().cols > 0) {
    MatrixF z;
    MESORIG_RETURN_IF_ERROR(MultiplyNewest(z, nullptr));
    AddProducts(z);
  }
  std::vector<double> energies;
  MESORIG_RETURN_IF_ERROR(SymmetricEigen(gram_, energies));
  const MatrixF w = FirstColumns(gram_, rank_);
  MatrixF u = Multiply(b_, false, w, false), r;
  MESORIG_RETURN_IF_ERROR(Orthonormalise(u, &r));
  MatrixD wide(r.rows, r.cols);
  std::copy(r.values.begin(), r.values.end(), wide.values.begin());
  MESORIG_ASSIGN_OR_RETURN(Svd svd, ThinSvd(std::move(wide)));
  TruncatedSvd result;
  result.u = Multiply(u, false, FirstColumns(svd.u, rank_), false);
  result.v = Multiply(Multiply(q_, false, w, false), false, FirstColumns(svd.v, rank_), false);
  MESORIG_RETURN_IF_ERROR(Straighten(result.v));
  const double square = reading_.square;
  result.residual = Residual(square, svd.sigma);
  for (double& s : svd.sigma) s /= blocks_.scale();
  result.sigma = std::move(svd.sigma);
  result.norm = std::sqrt(square) / blocks_.scale();
  result.power_steps = power_steps_;
  result.method = method;
  return result;
}

}  // namespace mesorig::codecs::algebra
