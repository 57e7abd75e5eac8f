#pragma once
// Where the rays of a pixel or of a texel's footprint go.

#include <array>

namespace mesorig::world {

// Point s of n * n in the unit square: one in each of the n x n cells, and one in each of the n * n
// columns and rows ("n-rooks"; for n = 2 the rotated grid), so that an edge along either axis is
// resolved n * n times, not n times. Their mean is the middle.
inline std::array<double, 2> StratumPoint(int s, int n) {
  const int a = s / n, b = s % n;
  return {(a * n + b + 0.5) / (n * n), (b * n + (n - 1 - a) + 0.5) / (n * n)};
}

}  // namespace mesorig::world
