#pragma once
// Internal to spherical_interpolation: the triangulation itself.

#include <array>
#include <vector>

#include "protocol/base/geometry.h"

namespace mesorig::btf {

// Delaunay triangulation on the unit sphere: the faces of the convex hull of the origin and the
// directions that do not touch the origin; centrally projected they cover the cone of the
// directions once, and the whole sphere when the origin lies inside. Triangles are counter-clockwise
// seen from outside. Cocircular directions (every ring pattern) are resolved by a fixed jitter of
// the coordinates, far below any real distance. Slivers, whose three directions lie on one great
// circle (1e-6 rad), are left out. Empty when all directions do. `directions`: unit vectors, at
// least 5e-5 rad apart. O(n^2).
std::vector<std::array<int, 3>> TriangulateSphere(const std::vector<Vec3>& directions);

}  // namespace mesorig::btf
