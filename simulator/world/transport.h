#pragma once
// Direct light from a point towards cameras: first hits kept in groups of eight, so that all lamps
// of one view share them, and one function that lights a group.

#include <vector>

#include "protocol/base/geometry.h"
#include "simulator/world/world.h"

namespace mesorig::world {

// A lamp at a point, or at infinity. Sample frame.
struct Light {
  Vec3 position_mm;        // or the unit direction to it
  bool at_infinity = false;
};

// Eight hits of one row, lane by lane; lanes beyond `count` are dark. `albedo_over_pi` holds the
// channels that are asked for: one (a Bayer pixel's own) or three.
struct alignas(32) HitBlock {
  float x[8]{}, y[8]{}, z[8]{};     // mm, lifted off the surface by a micrometre
  float nx[8]{}, ny[8]{}, nz[8]{};
  float vx[8]{}, vy[8]{}, vz[8]{};  // unit, towards the camera
  float cos_v[8]{};
  float albedo_over_pi[3][8]{};
  float specular[8]{}, alpha2[8]{};
  unsigned target[8]{};             // index of the pixel or texel that the hit counts for
  int count = 0;

  void Copy(const HitBlock& from, unsigned lane);  // adds one hit; there must be room
};

class HitRow {
 public:
  // v: unit vector from the hit towards the camera. channel -1 keeps all three colours.
  void Add(const SurfaceHit& hit, Vec3 v, unsigned target, int channel);
  const std::vector<HitBlock>& blocks() const { return blocks_; }
  void Clear() { blocks_.clear(); }
  size_t bytes() const { return blocks_.size() * sizeof(HitBlock); }

 private:
  std::vector<HitBlock> blocks_;
};

// The lobe specular * D G / (4 cos_l cos_v) of Material; cos2_h and sin2_h are those of the angle
// between normal and half vector. Finite for positive cosines.
inline float SpecularLobe(float cos_l, float cos_v, float cos2_h, float sin2_h, float specular,
                          float alpha2);

// response[c][k] = f_r,c cos(theta_l) / d^2 (mm^-2 sr^-1), for a light at infinity without 1/d^2;
// zero in shadow and where light or camera is behind the surface.
struct alignas(32) Response {
  float value[3][8];
};
void Illuminate(const World& world, const HitBlock& hits, const Light& light, int channels,
                Response& response);

inline float SpecularLobe(float cos_l, float cos_v, float cos2_h, float sin2_h, float specular,
                          float alpha2) {
  // Walter et al. 2007, Eq. 33 written with tan^2 = sin^2 / cos^2; Heitz 2014, Eq. 99.
  const float d = sin2_h + alpha2 * cos2_h;
  const float smith =
      cos_v * __builtin_sqrtf(alpha2 + (1 - alpha2) * cos_l * cos_l) +
      cos_l * __builtin_sqrtf(alpha2 + (1 - alpha2) * cos_v * cos_v);
  return specular * alpha2 * 0.5f / (3.14159265358979f * d * d * smith);
}

}  // namespace mesorig::world
