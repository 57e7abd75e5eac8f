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

// Records of several direction sets one after the other. Floats, so that one texel of a buffer
// texture is one row (a software rasteriser gathers texels far faster than it reads storage
// buffers: 7 times on a whole frame); whole numbers in them are exact. Measured directions are
// named by their index in their own set, records by their row.
struct DirectionTables {
  static constexpr int kMapSize = 64;  // cells along a side of a hemi-octahedral map

  // A triangle is four rows: for each corner the vector whose dot product with d is d's coordinate
  // along that corner (dual basis), and the corner's index; then, for each corner, the record
  // across the edge opposite to it: a triangle's row, or -1 - row of a hull edge.
  // A hull edge is three rows: its corners' directions and indices; then the edge that begins at
  // its second corner and the one that ends at its first (itself where there is none). A set of one
  // direction has one edge, from it to it.
  std::vector<std::array<float, 4>> rows;
  // Per set kMapSize^2 cells, row by row: the record to start with, coded as above.
  std::vector<float> map;

  // Appends a set; its map starts at the old map.size().
  void Append(const btf::DirectionInterpolator& set);
};

// The direction at the centre of map cell (i, j): u = (i + 1/2) / kMapSize * 2 - 1, p = ((u + v)/2,
// (u - v)/2) are the octahedral coordinates (x, y)/(|x| + |y| + z).
Vec3 MapCellDirection(int i, int j);

}  // namespace mesorig::renderer
