#include "renderer/tracer/silhouette_figures.h"

namespace mesorig::renderer {

StatusOr<BandFigures> CompareInBand(std::span<const uint8_t> base, std::span<const uint8_t> shrunk,
                                    std::span<const uint8_t> truth,
                                    std::span<const uint8_t> drawn) {
  if (shrunk.size() != base.size() || truth.size() != base.size() || drawn.size() != base.size()) {
    return InvalidArgument("masks of {}, {}, {} and {} pixels: permitted is one size", base.size(),
                           shrunk.size(), truth.size(), drawn.size());
  }
  BandFigures figures;
  size_t both = 0, either = 0;
  for (size_t i = 0; i < base.size(); ++i) {
    if (base[i] == 0 || shrunk[i] != 0) continue;
    ++figures.band_pixels;
    if (truth[i] != 0 && drawn[i] != 0) ++both;
    if (truth[i] != 0 || drawn[i] != 0) ++either;
  }
  if (figures.band_pixels == 0) {
    return FailedPrecondition(
        "no pixel lies between the silhouettes of the surface and of the surface without the "
        "relief's largest depth: draw the relief larger");
  }
  figures.iou = either == 0 ? 1 : static_cast<double>(both) / static_cast<double>(either);
  return figures;
}

}  // namespace mesorig::renderer
