#pragma once
// From one colour a pixel to three. Reentrant.

#include <cstdint>
#include <vector>

#include "processing/image/radiance.h"
#include "protocol/base/status.h"

namespace mesorig::image {

// Linear RGB radiance, W m^-2 sr^-1, interleaved (rgb of a pixel side by side), row by row.
struct RgbImage {
  int width = 0, height = 0;
  std::vector<float> rgb;
  // 1 where one of the pixel's colours depends on a saturated pixel; empty when none does.
  std::vector<uint8_t> saturated;
};

enum class PixelModel {
  kAverage,  // values are means over pixels, as the sensor measures them
  // Values at the pixels' centres: p - (p's Laplacian) / 24, exact for surfaces up to third degree.
  // What reconstruction by interpolation needs: interpolating means would blur by one more pixel.
  kCentre,
};

// Residual interpolation (Kiku et al. 2013) along local lines between colours (He et al. 2010): light
// and shadow are common to the colours, dyes are not, and within a few pixels both together leave
// the colours on a line. Own samples are kept; where there is no common detail it is bilinear
// interpolation. Mirrored at the borders. A mono image gives three equal channels. InvalidArgument
// for an image smaller than 4 x 4 pixels.
StatusOr<RgbImage> Demosaic(const MosaicImage& mosaic, PixelModel model = PixelModel::kCentre);

}  // namespace mesorig::image
