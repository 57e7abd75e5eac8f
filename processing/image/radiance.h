#pragma once
// A frame's bytes to radiance, pixel by pixel, before any interpolation. All functions reentrant.

#include <cstdint>
#include <span>
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
// `black_dn`: one a pixel, what it reads without light at this exposure; empty: the rig file's.
// InvalidArgument, naming the camera: a byte count that is not the camera's, a code value above
// the largest, an exposure that is not positive and finite, a camera model that cannot be inverted,
// another number of black levels.
StatusOr<MosaicImage> LinearRadiance(const Camera& camera, std::string_view bytes,
                                     double exposure_s, std::span<const float> black_dn = {});

// The code values as they are. `codes` has one a pixel. Errors as LinearRadiance's.
Status ReadCodes(const Camera& camera, std::string_view bytes, std::span<float> codes);

// Of a pixel's radiance, W^2 m^-4 sr^-2, by the sensor model: shot noise of `radiance` (negative
// ones have none), read noise and quantisation,
//   variance = (e + read_noise^2 + q^2 / 12) / (electrons_per_radiance_s exposure)^2,
// with e the electrons and q those of a code value.
double RadianceVariance(const Camera& camera, double radiance, double exposure_s);

}  // namespace mesorig::image
