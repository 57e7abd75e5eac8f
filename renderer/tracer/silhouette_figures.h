#pragma once
// How near a drawn silhouette comes to the true one, over the pixels where they can differ.

#include <cstdint>
#include <span>

#include "protocol/base/status.h"

namespace mesorig::renderer {

struct BandFigures {
  size_t band_pixels = 0;
  double iou = 0;  // |drawn and true| / |drawn or true| over the band; 1 when both are empty there
};

// Masks of one size, 1 inside. The band: inside `base`, the silhouette of the reference surface,
// and outside `shrunk`, that of the surface moved inwards by the relief's largest depth.
// InvalidArgument when the masks' sizes differ; FailedPrecondition when the band is empty.
StatusOr<BandFigures> CompareInBand(std::span<const uint8_t> base, std::span<const uint8_t> shrunk,
                                    std::span<const uint8_t> truth, std::span<const uint8_t> drawn);

}  // namespace mesorig::renderer
