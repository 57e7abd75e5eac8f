#include "processing/mesostructure/gaussian_peak.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace mesorig::mesostructure {
namespace {

constexpr int kParameters = 4;  // amplitude, centre, log sigma, background
constexpr int kMostSteps = 30;
constexpr double kConverged = 1e-5;  // of sigma

using Vector = std::array<double, kParameters>;
using Matrix = std::array<Vector, kParameters>;

// Cholesky factor in place (lower triangle); false when `a` is not positive definite.
bool Factor(Matrix& a) {
  for (size_t i = 0; i < kParameters; ++i) {
    for (size_t j = 0; j <= i; ++j) {
      double sum = a[i][j];
      for (size_t k = 0; k < j; ++k) sum -= a[i][k] * a[j][k];
      if (i != j) {
        a[i][j] = sum / a[j][j];
      } else if (sum > 1e-13 * a[i][i]) {  // also refuses NaN
        a[i][i] = std::sqrt(sum);
      } else {
        return false;
      }
    }
  }
  return true;
}

Vector Solve(const Matrix& factor, Vector b) {
  for (size_t i = 0; i < kParameters; ++i) {
    for (size_t k = 0; k < i; ++k) b[i] -= factor[i][k] * b[k];
    b[i] /= factor[i][i];
  }
  for (size_t i = kParameters; i-- > 0;) {
    for (size_t k = i + 1; k < kParameters; ++k) b[i] -= factor[k][i] * b[k];
    b[i] /= factor[i][i];
  }
  return b;
}

class Fit {
 public:
  Fit(std::span<const PeakSample> samples, const PeakPrior& prior)
      : samples_(samples), prior_(prior) {
    log_sigma_weight_ = Weight(prior.log_sigma_spread);
    background_weight_ = Weight(prior.background_spread);
  }

  // Twice the negative logarithm of the posterior; with `normal` and `gradient`, its quadratic
  // model.
  double Cost(const Vector& p, Matrix* normal, Vector* gradient) const {
    const double sigma = std::exp(p[2]), inverse = 1 / sigma;
    const double log_sigma_error = p[2] - std::log(prior_.sigma);
    const double background_error = p[3] - prior_.background;
    double cost = log_sigma_weight_ * log_sigma_error * log_sigma_error +
                  background_weight_ * background_error * background_error;
    if (normal != nullptr) {
      *normal = {}, *gradient = {};
      (*normal)[2][2] = log_sigma_weight_, (*normal)[3][3] = background_weight_;
      (*gradient)[2] = -log_sigma_weight_ * log_sigma_error;
      (*gradient)[3] = -background_weight_ * background_error;
    }
    for (const PeakSample& s : samples_) {
      const double z = (s.x - p[1]) * inverse, bell = std::exp(-0.5 * z * z);
      const double error = s.y - p[3] - p[0] * bell, weight = 1 / s.variance;
      cost += weight * error * error;
      if (normal == nullptr) continue;
      const Vector d = {bell, p[0] * bell * z * inverse, p[0] * bell * z * z, 1};
      for (size_t i = 0; i < kParameters; ++i) {
        (*gradient)[i] += weight * error * d[i];
        for (size_t j = 0; j <= i; ++j) (*normal)[i][j] += weight * d[i] * d[j];
      }
    }
    return cost;
  }

 private:
  static double Weight(double spread) { return std::isfinite(spread) ? 1 / (spread * spread) : 0; }

  std::span<const PeakSample> samples_;
  const PeakPrior& prior_;
  double log_sigma_weight_ = 0, background_weight_ = 0;
};

// Levenberg-Marquardt; false when no step is left that makes sense.
bool Minimise(const Fit& fit, Vector& p) {
  Matrix normal, damped;
  Vector gradient;
  double damping = 1e-3;
  double cost = fit.Cost(p, &normal, &gradient);
  for (int step = 0; step < kMostSteps; ++step) {
    damped = normal;
    for (size_t i = 0; i < kParameters; ++i) damped[i][i] *= 1 + damping;
    if (!Factor(damped)) return false;
    Vector next = Solve(damped, gradient);
    next[2] = std::clamp(next[2], -0.7, 0.7);  // sigma at most doubles or halves in a step
    const double moved = std::abs(next[1]) / std::exp(p[2]) + std::abs(next[2]);
    for (size_t i = 0; i < kParameters; ++i) next[i] += p[i];
    const double next_cost = fit.Cost(next, nullptr, nullptr);
    if (!(next_cost <= cost)) {  // also when it is NaN
      if ((damping *= 8) > 1e6) return std::isfinite(cost);
      continue;
    }
    p = next;
    cost = fit.Cost(p, &normal, &gradient);
    if (moved < kConverged) return true;
    damping = std::max(damping / 8, 1e-7);
  }
  return std::isfinite(cost);
}

}  // namespace

std::optional<GaussianPeak> FitGaussianPeak(std::span<const PeakSample> samples,
                                            const PeakPrior& prior) {
  if (samples.size() < 3 || !(prior.sigma > 0) || !(prior.amplitude > 0)) return std::nullopt;
  const Fit fit(samples, prior);
  Vector p = {prior.amplitude, prior.centre, std::log(prior.sigma), prior.background};
  if (!Minimise(fit, p)) return std::nullopt;
  Matrix normal;
  Vector gradient;
  const double cost = fit.Cost(p, &normal, &gradient);
  if (!Factor(normal)) return std::nullopt;
  GaussianPeak peak;
  peak.amplitude = p[0], peak.centre = p[1], peak.sigma = std::exp(p[2]), peak.background = p[3];
  peak.centre_variance = Solve(normal, {0, 1, 0, 0})[1];
  const auto freedom = static_cast<double>(samples.size()) - 3;
  peak.chi_square = cost / std::max(freedom, 1.0);
  const auto [first, last] =
      std::minmax_element(samples.begin(), samples.end(),
                          [](const PeakSample& a, const PeakSample& b) { return a.x < b.x; });
  const bool within = peak.centre >= first->x - peak.sigma && peak.centre <= last->x + peak.sigma;
  const bool determined = peak.centre_variance <= peak.sigma * peak.sigma;
  // Written so that NaN is refused.
  if (!(peak.amplitude > 0 && within && determined && std::isfinite(cost))) return std::nullopt;
  return peak;
}

}  // namespace mesorig::mesostructure
