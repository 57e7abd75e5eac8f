#pragma once
// From the displacement images of one view to its part of the MDF. Reentrant.

#include <span>

#include "processing/btf/mdf.h"

namespace mesorig::mesostructure {

// Distances that differ by no more than this are of one surface.
double AgreementMm(double pitch_mm);

// Texel by texel. Each image tells one distance with a weight (Displacement); those that agree with
// one of them stand together, and the group with the greatest sum of root weights wins: two sweeps
// that agree outvote a third, and a depth step is never averaged over. The distance is the winners'
// mean, weighted by the tetrahedra (Wang et al. 2005, Sec. 3.2; there without a vote). The
// confidence is the sum of the winners' weights, times their share in all weights: 1 is one perfect
// sweep that nothing contradicts. Texels without any keep 0 and 0. All spans have W*H values.
void MergeImages(std::span<const btf::Mdf> images, std::span<float> distance,
                 std::span<float> confidence);

// Fills the texels of confidence 0 smoothly from those around (pyramid, then Laplace's equation by
// relaxation); their confidence stays 0. False, and nothing done, when there is no measured texel.
bool FillHoles(int width, int height, std::span<float> distance, std::span<const float> confidence);

}  // namespace mesorig::mesostructure
