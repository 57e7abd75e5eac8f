#pragma once
// An object's surface, displaced along its normals by a height over the sample's plane.

#include <functional>
#include <vector>

#include "renderer/scene/mesh.h"

namespace mesorig::renderer {

// World, mm. Triangles share no vertices.
struct SurfaceMesh {
  std::vector<std::array<float, 3>> vertices;
  std::vector<std::array<float, 2>> uv;  // repeats of the sample from its top left corner, v down
  std::vector<std::array<uint32_t, 3>> triangles;
};

// What a repeat of the texture shows: width_mm x height_mm of the sample's plane.
struct SampleSize {
  double width_mm = 0, height_mm = 0;
};

// Height above the reference plane (negative below it), mm of the sample, at (x, y) of the sample
// frame, within the sample: the texture repeats.
using HeightFunction = std::function<double(double x_mm, double y_mm)>;

// The surface of MakeMesh(object), its triangles halved until no edge is longer than `max_edge_mm`,
// every corner moved along its normal by `height` times the square root of the area stretch
// (DESIGN, "On a mesh"; nothing where the texture has no area). A null `height` displaces nothing.
// InvalidArgument when there would be more than 20 million triangles.
StatusOr<SurfaceMesh> DisplaceSurface(const Object& object, TextureScale scale, SampleSize sample,
                                      const HeightFunction& height, double max_edge_mm);

// The area of an object's surface, mm^2.
double SurfaceArea(const Object& object);

}  // namespace mesorig::renderer
