#pragma once
// The interpolation of btf::DirectionInterpolator in a form that a fragment shader walks
// (shaders/directions.glsl): a map over the hemisphere says in which triangle to start, the
// triangles' neighbours lead to the one that holds the direction, so that weights are exact and
// nothing steps at the map's cells; beyond the measured cone the hull's edges lead to the nearest
// point. Pure data, no OpenGL.

#include <array>
#include <cstdint>
#include <vector>

#include "processing/btf/spherical_interpolation.h"

namespace mesorig::renderer {

// Entries of several direction sets one after the other; every index counts from the start of the
// whole array, so that the shader needs the place of a set's map only.
struct DirectionTables {
  static constexpr int kMapSize = 64;  // cells along a side of a hemi-octahedral map

  std::vector<std::array<float, 4>> directions;  // xyz
  // Two entries a triangle: its corners, counter-clockwise seen from outside; then its neighbours
  // across the edge opposite to each corner: a triangle, or -1 - edge at the hull.
  std::vector<std::array<int32_t, 4>> triangles;
  // Corners a and b, the edge that begins at b and the one that ends at a (itself: none). A set
  // of one direction has the edge {a, a, itself, itself}.
  std::vector<std::array<int32_t, 4>> hull;
  // Per set kMapSize^2 cells, row by row: the triangle to start in, or -1 - edge where the set has
  // no triangles.
  std::vector<int32_t> map;

  // Appends a set: its directions start at the old directions.size(), its map at the old map.size().
  void Append(const btf::DirectionInterpolator& set);
};

// The direction at the centre of map cell (i, j): u = (i + 1/2) / kMapSize * 2 - 1, p = ((u + v)/2,
// (u - v)/2) are the octahedral coordinates (x, y)/(|x| + |y| + z).
Vec3 MapCellDirection(int i, int j);

}  // namespace mesorig::renderer
