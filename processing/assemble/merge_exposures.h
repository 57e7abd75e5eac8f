#pragma once
// One picture of those of one view under one light that were taken with several exposures.
// Reentrant.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "protocol/rig/rig.h"

namespace mesorig::assemble {

// BTF values of one frame; all borrowed.
struct ExposedFrame {
  std::span<const float> values;       // 3 a texel
  std::span<const uint8_t> saturated;  // 1 a texel: 1 where a value is a lower bound
  const Camera* camera = nullptr;
  double exposure_s = 0;
  std::array<double, 3> irradiance{};  // mean over the texels: radiance = value * irradiance
};

// Weighted by the inverse of the variance that the sensor model (image::RadianceVariance) tells for
// the radiance that all frames together have: of its own noisy radiance a frame would tell too
// small a variance where it is too dark, and pull the mean down. Saturated texels are left out; one
// that all frames saturate gets the mean of the shortest exposure's, a lower bound. Returns how
// many texels these are. `merged`: 3 values a texel.
size_t MergeExposures(std::span<const ExposedFrame> frames, std::span<float> merged);

}  // namespace mesorig::assemble
