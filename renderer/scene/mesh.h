#pragma once
// Triangle meshes with what a BTF needs at every vertex: a right-handed tangent frame and texture
// coordinates in millimetres on the surface.

#include <cstdint>
#include <vector>

#include "renderer/scene/scene.h"

namespace mesorig::renderer {

// Object frame, millimetres. The frame (tangent, Cross(normal, tangent), normal) carries the
// sample frame's (x, y, z): the tangent points where the sample's +x points on the surface.
struct Vertex {
  float position[3];
  float normal[3];      // unit, outwards
  float tangent[3];     // unit, perpendicular to the normal
  float texture_mm[2];  // along the sample's +x and +y; (0, 0) is the sample's centre
};

struct Mesh {
  std::vector<Vertex> vertices;
  std::vector<uint32_t> indices;  // three a triangle, counter-clockwise seen from outside
};

// How the texture lies on the surface at a vertex: mm of the surface (object frame) for a
// millimetre of Vertex::texture_mm along +x and +y. Both zero where the texture has no area.
struct Stretch {
  float along_x[3], along_y[3];
};
// One a vertex: the mean over its triangles of d(surface)/d(texture), weighted by their texture
// area. Triangles whose texture has (next to) no area do not count.
std::vector<Stretch> StretchOf(const Mesh& mesh);

// Square root of the area stretch: by how much the mesostructure's heights grow on the surface when
// a millimetre of the texture is a millimetre of the sample (DESIGN, "On a mesh"). 0 where there is
// no map.
double HeightScale(const Stretch& stretch);

// A torus around z: +x of the sample runs along the tube (counter-clockwise seen from +z), +y
// around it (on the upper side towards the axis). Texture lengths are true on the circle of the
// major radius and stretch by 1 + (minor/major) cos(phi) elsewhere.
Mesh MakeTorus(double major_radius_mm, double minor_radius_mm, int major_segments,
               int minor_segments);

// A box centred at the origin. The sample lies upright on the top (+x, +y as the box) and continues
// over the four upper edges without a seam; the bottom continues the side that faces -y.
// With rounding > 0 edges are quarter cylinders and corners are spheres.
Mesh MakeSlab(Vec3 size_mm, double rounding_mm);

// The mesh of an object, before its rotation and position.
Mesh MakeMesh(const Object& object);

// world_from_object of an object.
RigidTransform Placement(const Object& object);

// Surface millimetres to texture units (repeats of the sample): u = scale.x * x, v = scale.y * y.
struct TextureScale {
  double x = 1, y = 1;
};
// For a sample of width_mm x height_mm. InvalidArgument when the sample's size is unknown (0) and
// the object does not give mm_per_unit; `aspect` is height over width in texels.
StatusOr<TextureScale> ScaleTexture(const Object& object, double width_mm, double aspect);

}  // namespace mesorig::renderer
