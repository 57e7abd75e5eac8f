#include "processing/mesostructure/pixel_peak.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "processing/mesostructure/gaussian_peak.h"

namespace mesorig::mesostructure {
namespace {

constexpr double kLeastSnr = 6;
constexpr double kWindow = 3;         // expected sigmas to both sides
constexpr double kApart = 4;          // expected sigmas between two peaks that are two
constexpr double kModelError = 0.02;  // of the height: relief within the pixel, texture
constexpr double kSecondRefused = 0.5, kSecondDoubted = 0.25;
constexpr double kNarrowest = 0.5, kWidest = 3;
constexpr double kWidthSpread = 0.35;  // of log(width by expected width)
constexpr size_t kMostSamples = 64;    // of a peak; a sweep so fine that it has more is thinned

size_t Highest(std::span<const PixelSample> samples) {
  size_t top = 0;
  for (size_t k = 1; k < samples.size(); ++k) {
    if (samples[k].electrons > samples[top].electrons) top = k;
  }
  // A saturated peak is a plateau: its middle.
  size_t last = top;
  while (samples[top].saturated && last + 1 < samples.size() && samples[last + 1].saturated) ++last;
  return (top + last) / 2;
}

// How far a second peak takes the quality down; 0 refuses.
double SecondPeakFactor(std::span<const PixelSample> samples, double centre, double apart,
                        double height, double noise) {
  double second = 0;
  for (const PixelSample& s : samples) {
    if (std::abs(s.tilt_rad - centre) > apart) second = std::max<double>(second, s.electrons);
  }
  if (second < kLeastSnr * noise || second < kSecondDoubted * height) return 1;
  return second < kSecondRefused * height ? 0.3 : 0;
}

}  // namespace

std::optional<PixelPeak> FindPixelPeak(std::span<const PixelSample> samples,
                                       const PeakModel& model) {
  if (samples.size() < 3 || !(model.sigma_rad > 0)) return std::nullopt;
  const size_t top = Highest(samples);
  const double height = samples[top].electrons, centre = samples[top].tilt_rad;
  const double noise = std::max(model.read_noise_e, 1e-3);
  if (!(height > kLeastSnr * noise)) return std::nullopt;
  const double spacing = std::abs(samples.back().tilt_rad - samples.front().tilt_rad) /
                         static_cast<double>(samples.size() - 1);
  const double reach = std::max(kWindow * model.sigma_rad, 2.5 * spacing);
  std::array<PeakSample, kMostSamples> around;
  size_t count = 0;
  const double error = kModelError * height;
  for (const PixelSample& s : samples) {
    if (s.saturated || std::abs(s.tilt_rad - centre) > reach || count == around.size()) continue;
    const double variance = noise * noise + std::max<double>(s.electrons, 0) + error * error;
    around[count++] = {s.tilt_rad, s.electrons, variance};
  }
  const PeakPrior prior{centre, height, model.sigma_rad, 0.5, 0, 0.1 * height + noise};
  const auto peak = FitGaussianPeak(std::span(around.data(), count), prior);
  if (!peak || std::abs(peak->centre - centre) > reach) return std::nullopt;
  const auto [low, high] = std::minmax(samples.front().tilt_rad, samples.back().tilt_rad);
  const double ratio = peak->sigma / model.sigma_rad;
  if (peak->centre < low || peak->centre > high || !(ratio > kNarrowest && ratio < kWidest)) {
    return std::nullopt;
  }
  const double second =
      SecondPeakFactor(samples, peak->centre, kApart * std::max(peak->sigma, model.sigma_rad),
                       std::max(height, peak->amplitude), noise);
  if (second == 0) return std::nullopt;
  const double width = std::log(ratio) / kWidthSpread;
  PixelPeak result;
  result.tilt_rad = peak->centre;
  result.variance = peak->centre_variance * std::max(1.0, peak->chi_square);
  result.quality = second * std::exp(-0.5 * width * width) / std::max(1.0, peak->chi_square / 3);
  result.electrons = peak->amplitude;
  // Two samples next to each other and nothing at their sides do not show a peak.
  if (!(result.quality > 1e-3) || !(result.variance < peak->sigma * peak->sigma)) {
    return std::nullopt;
  }
  return result;
}

}  // namespace mesorig::mesostructure
