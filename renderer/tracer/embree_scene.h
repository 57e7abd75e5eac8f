#pragma once
// Triangles that rays are shot at: what this folder uses of Embree 3. Immutable after construction;
// reentrant.

#include <embree3/rtcore.h>

#include <array>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"

namespace mesorig::renderer {

class EmbreeScene {
 public:
  // Unavailable with Embree's error. Triangles name existing vertices, which are finite.
  static StatusOr<EmbreeScene> Create(const std::vector<std::array<float, 3>>& vertices,
                                      const std::vector<std::array<uint32_t, 3>>& triangles);
  EmbreeScene(EmbreeScene&& other) noexcept;
  EmbreeScene& operator=(EmbreeScene&& other) noexcept;
  ~EmbreeScene();

  struct Hit {
    bool any = false;
    float t = 0;  // in units of the direction's length
    uint32_t triangle = 0;
    float b = 0, c = 0;  // weights of the second and third corner
    Vec3 normal;         // of the triangle, not normalised
  };
  Hit Intersect(Vec3 origin, Vec3 direction, float nearest) const;
  bool Occluded(Vec3 origin, Vec3 direction, float nearest) const;

 private:
  EmbreeScene() = default;
  RTCDevice device_ = nullptr;
  RTCScene scene_ = nullptr;
};

}  // namespace mesorig::renderer
