#pragma once
// The line of a laser stripe in an image: candidates, profile by profile, then a robust line. Image
// coordinates: pixel (i, j) covers [i, i+1) x [j, j+1), its centre is (i + 1/2, j + 1/2); u to the
// right, v down. All functions reentrant.

#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::mesostructure {

// Values of one colour, row by row. They are linear in light up to `saturation`.
struct StripeImage {
  int width = 0, height = 0;
  std::vector<float> value;
  std::vector<uint8_t> usable;  // 0: not to be looked at; empty: all are
  float saturation = std::numeric_limits<float>::infinity();  // at and above: a lower bound
  // Variance of a value y: noise^2 + shot * max(y - background, 0). noise 0: estimated, profile by
  // profile.
  double noise = 0, shot = 0;
};

// The direction that a profile runs in: across the stripe, roughly.
enum class Profiles { kRows, kColumns };

// Where a profile crosses the stripe. `across` runs along the profile (u for rows), `along` is the
// other coordinate of the profile's pixel centres.
struct StripeCandidate {
  double along = 0, across = 0;
  double variance = 0;  // of across, px^2
  double sigma_px = 0, peak = 0;
};

struct StripeOptions {
  double least_snr = 6;         // the peak above its background, in standard deviations of noise
  double sigma_px = 0;          // of the stripe across the profile; 0: taken from the profile
  double second_peak = 0.5;     // of the first: two stripes, the profile is refused
  double least_candidates = 8;  // for a line
};

// At most one a profile. None where nothing stands out, where two peaks do, where the peak is cut
// by the image's or the usable part's edge, or where saturation hides the centre. A second peak
// between half of `second_peak` and `second_peak` triples the variance.
std::vector<StripeCandidate> FindStripe(const StripeImage& image, Profiles profiles,
                                        const StripeOptions& options);
// The direction with candidates in the greater share of its profiles.
Profiles ChooseProfiles(const StripeImage& image, const StripeOptions& options);

// across = position + slope (along - centre): position and slope are uncorrelated at `centre`.
struct StripeLine {
  Profiles profiles = Profiles::kRows;
  double centre = 0;
  double position = 0, slope = 0;
  double position_variance = 0, slope_variance = 0;
  double residual_px = 0;  // standard deviation of the candidates around it
  int candidates = 0, inliers = 0;
  double At(double along) const { return position + slope * (along - centre); }
  double VarianceAt(double along) const {
    return position_variance + (along - centre) * (along - centre) * slope_variance;
  }
};
// Least median of squares (Rousseeuw 1984) over pairs from a fixed generator, then iteratively
// reweighted least squares (Tukey's biweight). FailedPrecondition, saying why, when there are too
// few candidates or fewer than half of them lie on one line.
StatusOr<StripeLine> FitStripeLine(std::span<const StripeCandidate> candidates, Profiles profiles,
                                   const StripeOptions& options);

}  // namespace mesorig::mesostructure
