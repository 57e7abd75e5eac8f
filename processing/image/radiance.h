#pragma once
// A frame's bytes to radiance, pixel by pixel, before any interpolation. All functions reentrant.

#include <cstdint>
#include <string_view>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/rig/rig.h"

namespace mesorig::image {

// One value a pixel, of the colour that the pixel's filter passes (0 red, 1 green, 2 blue).
struct MosaicImage {
  int width = 0, height = 0;
  BayerPattern pattern = BayerPattern::kMono;
  // W m^-2 sr^-1, row by row from the top. Read noise makes some values negative: they are kept,
  // since cutting them off would brighten the dark.
  std::vector<float> radiance;
  // 1 where the code value stands within SaturationMarginDn of the largest one: the radiance is a
  // lower bound. Empty when no pixel is.
  std::vector<uint8_t> saturated;
};

// Colour of pixel (column, row); a mono camera has none and answers 1.
int ColourAt(BayerPattern pattern, int column, int row);

// A full well is read out with noise, so that a saturated pixel may lie below the largest code
// value: one code value and four standard deviations of the read noise.
int SaturationMarginDn(const Camera& camera);

// The camera model of protocol/rig/rig.h, inverted (gain 1):
//   radiance = (code - black) / (white - black) * full_well / (electrons_per_radiance_s exposure).
// `bytes`: width x height codes, row by row; 8 bits in one byte, up to 16 in two, little-endian.
// InvalidArgument, naming the camera: a byte count that is not the camera's, a code value above
// the largest, an exposure that is not positive and finite, a camera model that cannot be inverted.
StatusOr<MosaicImage> LinearRadiance(const Camera& camera, std::string_view bytes,
                                     double exposure_s);

}  // namespace mesorig::image
