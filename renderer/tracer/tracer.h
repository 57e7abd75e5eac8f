#pragma once
// Pictures and masks of surfaces by shooting rays at them. Diffuse shading of the facets under the
// scene's lights with hard shadows; no light bounces.

#include <span>
#include <vector>

#include "renderer/scene/picture.h"
#include "renderer/tracer/displaced_mesh.h"
#include "renderer/tracer/embree_scene.h"

namespace mesorig::renderer {

// rho / pi (sr^-1), linear RGB, W*H*3, row by row from the top; repeats. Borrowed.
struct AlbedoTexture {
  int width = 0, height = 0;
  std::span<const float> rgb;
};

// Immutable; reentrant.
class Tracer {
 public:
  // One surface an object. Unavailable with Embree's error.
  static StatusOr<Tracer> Create(std::vector<SurfaceMesh> surfaces);
  // 1 where the ray through the pixel's centre hits anything; rows from the top.
  std::vector<uint8_t> Mask(const Scene& scene) const;
  // The picture that gl/ would draw of these surfaces with the material "plain", with shadows:
  // same camera, exposure, background and samples a pixel.
  Picture Draw(const Scene& scene, const AlbedoTexture& albedo) const;
  size_t triangle_count() const;

 private:
  struct Surface {
    SurfaceMesh mesh;
    EmbreeScene scene;
  };
  struct Hit {
    const Surface* surface = nullptr;  // null: nothing
    EmbreeScene::Hit hit;
  };
  explicit Tracer(std::vector<Surface> surfaces) : surfaces_(std::move(surfaces)) {}
  Hit Nearest(Vec3 origin, Vec3 direction) const;
  bool InShadow(Vec3 origin, Vec3 direction) const;
  Vec3 Radiance(const Scene& scene, const AlbedoTexture& albedo, Vec3 direction,
                const Hit& found) const;
  std::vector<Surface> surfaces_;
};

}  // namespace mesorig::renderer
