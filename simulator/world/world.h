#pragma once
// The sample as triangles for rays. Sample frame, millimetres. Facet normals are the shading
// normals: what is lit and what shadows is one geometry.

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"
#include "simulator/world/surface.h"

namespace mesorig::world {

struct SurfaceHit {
  Vec3 p, normal;  // unit, on the ray's side
  Material material;
};

struct TriangleMesh {
  std::vector<std::array<float, 3>> vertices;      // mm, sample frame
  std::vector<std::array<unsigned, 3>> triangles;  // counter-clockwise from above
};

// Immutable after construction; all functions are reentrant.
class World {
 public:
  // InvalidArgument when the extent or grid is not positive or makes more than 4096 cells a side,
  // or a height is negative or not finite. Internal when Embree fails.
  static StatusOr<std::unique_ptr<World>> Build(Surface surface);
  ~World();
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  const Surface& surface() const { return surface_; }
  double top_mm() const { return top_mm_; }  // of the triangles
  TriangleMesh Mesh() const;                 // a copy of what rays meet

  // Where the ray first meets the sample from above; nothing when it misses it or comes from below.
  // `direction` is a unit vector.
  std::optional<SurfaceHit> FirstHit(Vec3 origin, Vec3 direction) const;

  // Shadow rays, eight at once: occluded[k] becomes 1 where something lies on the ray from
  // origin[k] towards direction[k] within length[k]. Lanes with active[k] == 0 are left alone.
  struct alignas(32) Rays8 {
    float ox[8], oy[8], oz[8], dx[8], dy[8], dz[8], length[8];
    int active[8];  // -1 or 0
    int occluded[8];
  };
  void Occluded(Rays8& rays) const;

 private:
  explicit World(Surface surface);
  Status BuildTriangles();

  Surface surface_;
  double top_mm_ = 0;
  struct Embree;
  std::unique_ptr<Embree> embree_;
};

}  // namespace mesorig::world
