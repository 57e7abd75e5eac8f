#pragma once
// Space-time analysis (Curless and Levoy 1995): when, between which tilts of the sheet, a pixel was
// brightest. Reentrant.

#include <optional>
#include <span>

namespace mesorig::mesostructure {

// One pixel over the frames of a sweep that have a tilt, in order: electrons above black.
struct PixelSample {
  double tilt_rad = 0;
  float electrons = 0;
  bool saturated = false;  // a lower bound
};

struct PeakModel {
  double read_noise_e = 0;
  double sigma_rad = 0;  // of the sheet, at the distance where the pixel looks
};

struct PixelPeak {
  double tilt_rad = 0;
  double variance = 0;   // rad^2: noise, and what the model leaves open
  double quality = 0;    // (0, 1]: 1 is one clean peak of the expected width
  double electrons = 0;  // its height
};

// Nothing: no peak above six standard deviations, a second one of half its height, a peak at the
// sweep's ends, saturated flanks, or a width that is none of the sheet's (less than half or more
// than three times). Down-weighted: a second peak of a quarter, a width or shape that differs.
std::optional<PixelPeak> FindPixelPeak(std::span<const PixelSample> samples,
                                       const PeakModel& model);

}  // namespace mesorig::mesostructure
