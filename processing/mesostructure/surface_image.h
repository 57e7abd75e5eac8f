#pragma once
// From the points that pixels saw to texels, without holes between pixels. Reentrant.

#include <span>
#include <vector>

#include "protocol/plan/plan.h"

namespace mesorig::mesostructure {

// A point of the surface in the texture space of a view: (x, y) = p.xy + D v.xy on the reference
// plane, mm; weight 0: none.
struct SurfacePoint {
  double x = 0, y = 0, distance = 0;
  double weight = 0;
};

// Two neighbours whose distances differ by more than this, and by more than kSteepest times their
// distance on the reference plane, have a depth step between them: nothing is drawn across.
inline constexpr double kStep_mm = 0.35, kSteepest = 1.5;

// `points`: columns x rows, row by row, as they lie in the camera's image; the quads of neighbours
// are drawn at the centres of the texels, as two triangles each; of two the nearer (smaller
// distance) wins. A texel that no quad covers takes the nearest point that falls into it, at half
// the weight. `distance` and `weight`: one value a texel of the product, overwritten; 0 and 0 where
// nothing was drawn. Distances are >= 0.
void DrawSurface(std::span<const SurfacePoint> points, int columns, int rows,
                 const Product& product, std::span<float> distance, std::span<float> weight);

}  // namespace mesorig::mesostructure
