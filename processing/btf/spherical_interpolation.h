#pragma once
// Interpolation between measured directions on the upper hemisphere, on the sphere and never in
// (theta, phi): the azimuth is meaningless at the pole.

#include <array>
#include <vector>

#include "processing/btf/direction_grid.h"
#include "protocol/base/geometry.h"
#include "protocol/base/status.h"

namespace mesorig::btf {

// At most three measured directions and their weights, which sum to one; unused ones have weight 0
// and index 0.
struct DirectionWeights {
  std::array<int, 3> index{};
  std::array<float, 3> weight{};
};

// Immutable after construction; lookups are reentrant, and take a time that does not grow with the
// number of directions.
class DirectionInterpolator {
 public:
  // Delaunay triangulation of the directions on the sphere. Works for one direction, for two, for
  // collinear (one great circle) ones; of directions that coincide (5e-5 rad) only the first is
  // ever chosen. InvalidArgument for none or for one that is zero or not finite.
  static StatusOr<DirectionInterpolator> Build(const std::vector<Vec3>& directions);
  // Barycentric weights in the triangle that holds d, or the nearest point of the hull for a
  // direction beyond the measured cone: continuous across triangles and across the hull, exact at
  // the measured directions. The weighted sum of the chosen directions points towards d (or towards
  // the nearest point of the hull). d need not be normalised; a zero or NaN direction gives
  // the direction nearest to +z with weight 1.
  DirectionWeights Lookup(Vec3 d) const {
    bool inside = false;
    return Lookup(d, inside);
  }
  // The same; says whether a triangle holds d.
  DirectionWeights Lookup(Vec3 d, bool& inside) const;
  bool Inside(Vec3 d) const;  // d lies within the measured cone
  const std::vector<std::array<int, 3>>& triangles() const { return triangles_; }
  const std::vector<Vec3>& directions() const { return directions_; }
  // Edges {a, b} of the measured cone, counter-clockwise; empty for one direction.
  const std::vector<std::array<int, 2>>& hull() const { return hull_; }

 private:
  DirectionInterpolator() = default;
  DirectionWeights OnRim(Vec3 d) const;
  std::vector<Vec3> directions_;               // normalised
  std::vector<std::array<int, 3>> triangles_;  // counter-clockwise seen from outside
  std::vector<std::array<Vec3, 3>> inverse_;   // dual basis of each triangle: weight_k ~ inverse_k . d
  std::vector<std::array<int, 2>> hull_;       // boundary edges; empty for one direction
  std::vector<Arc> arcs_;                      // the same
  DirectionGrid grid_;
  int zenith_ = 0;                             // the direction nearest to +z
};

// Beyond the measured cone the nearest direction's value is scaled by cos(theta_l) /
// cos(theta_nearest), and is zero below the horizon (DESIGN, "BTF value"). `chosen` is what Lookup
// returned for l: its weighted direction is l itself inside the cone, where the scale is 1. At most
// kMaxHorizonScale: for a nearest direction at the horizon the quotient has no bound.
inline constexpr double kMaxHorizonScale = 4;
double HorizonScale(const DirectionInterpolator& lights, const DirectionWeights& chosen, Vec3 l);

}  // namespace mesorig::btf
