#pragma once
// Which frames looked, or were lit, from the same place. Reentrant.

#include <span>
#include <vector>

#include "protocol/base/geometry.h"

namespace mesorig::assemble {

// Two positions are one when both hold: a camera at the zenith is one view at every turntable
// angle, and lamps whose turntable and arc angles give the same azimuth are one light.
inline constexpr double kSameDirection = 1e-3;  // rad, seen from the centre of the reference plane
inline constexpr double kSamePosition = 0.5;    // mm

struct MergedPositions {
  // Ordered by polar angle (rings of 2 mrad), then azimuth. Positions are the means of those
  // merged, directions are from the centre to them.
  std::vector<Vec3> positions_mm, directions;
  std::vector<int> index_of;  // for each input, its entry above
};
// Inputs are compared with the first of each entry, in order: the result depends on nothing but
// the order of the input.
MergedPositions MergePositions(std::span<const Vec3> positions_mm, Vec3 centre_mm);

}  // namespace mesorig::assemble
