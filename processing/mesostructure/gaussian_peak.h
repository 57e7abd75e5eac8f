#pragma once
// The peak that a laser sheet leaves behind, along a profile of an image or over the frames of a
// sweep: y(x) = background + amplitude exp(-(x - centre)^2 / (2 sigma^2)). Reentrant.

#include <optional>
#include <span>

namespace mesorig::mesostructure {

// `variance` of y is of the noise alone (> 0); samples that are not to be used (saturated, of
// another colour) are left out by the caller.
struct PeakSample {
  double x = 0, y = 0, variance = 1;
};

struct GaussianPeak {
  double centre = 0, sigma = 0;          // in the unit of x
  double amplitude = 0, background = 0;  // in the unit of y
  double centre_variance = 0;            // by the noise of the samples (Cramer-Rao), sigma unknown
  double chi_square = 0;                 // of the samples, per degree of freedom
};

// What is known before: a start for the fit, and how far sigma and background may be believed. The
// spreads are standard deviations; infinite means free.
struct PeakPrior {
  double centre = 0, amplitude = 0;
  double sigma = 1, log_sigma_spread = 0.5;
  double background = 0, background_spread = 1;
};

// Maximum a posteriori by Levenberg-Marquardt. Nothing when there are fewer than three samples,
// when the peak is not above the background, when it leaves the samples' range by more than a
// sigma, or when the samples do not determine its centre to a sigma (all on one flank, all
// saturated).
std::optional<GaussianPeak> FitGaussianPeak(std::span<const PeakSample> samples,
                                            const PeakPrior& prior);

inline constexpr double kFwhmPerSigma = 2.3548200450309493;  // 2 sqrt(2 ln 2)

}  // namespace mesorig::mesostructure
