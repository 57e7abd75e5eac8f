#include "simulator/world/transport.h"

#include <algorithm>

namespace mesorig::world {
namespace {

// Lifts shadow rays off the facet that they start on: single precision is some 4e-6 mm here.
constexpr double kLiftMm = 1e-3;

// Directions to the light and shadow rays; cos_l is 0 where there is nothing to light.
struct alignas(32) Geometry {
  float lx[8], ly[8], lz[8], cos_l[8], inverse_d2[8];
};

void Aim(const HitBlock& h, const Light& light, Geometry& g, World::Rays8& rays) {
  const auto px = static_cast<float>(light.position_mm.x);
  const auto py = static_cast<float>(light.position_mm.y);
  const auto pz = static_cast<float>(light.position_mm.z);
  const float near = light.at_infinity ? 0.0f : 1.0f;
  for (int k = 0; k < 8; ++k) {
    const float dx = px - near * h.x[k], dy = py - near * h.y[k], dz = pz - near * h.z[k];
    const float d2 = dx * dx + dy * dy + dz * dz;
    const float inverse = 1 / __builtin_sqrtf(d2);
    g.lx[k] = dx * inverse;
    g.ly[k] = dy * inverse;
    g.lz[k] = dz * inverse;
    g.inverse_d2[k] = near * inverse * inverse + (1 - near);
    const float c = h.nx[k] * g.lx[k] + h.ny[k] * g.ly[k] + h.nz[k] * g.lz[k];
    g.cos_l[k] = c > 0 && h.cos_v[k] > 0 ? c : 0.0f;
    rays.ox[k] = h.x[k];
    rays.oy[k] = h.y[k];
    rays.oz[k] = h.z[k];
    rays.dx[k] = g.lx[k];
    rays.dy[k] = g.ly[k];
    rays.dz[k] = g.lz[k];
    rays.length[k] = near * (d2 * inverse) + (1 - near) * 1e9f;
    rays.active[k] = g.cos_l[k] > 0 ? -1 : 0;
    rays.occluded[k] = 0;
  }
}

}  // namespace

void HitBlock::Copy(const HitBlock& from, unsigned lane) {
  const int k = count++;
  x[k] = from.x[lane], y[k] = from.y[lane], z[k] = from.z[lane];
  nx[k] = from.nx[lane], ny[k] = from.ny[lane], nz[k] = from.nz[lane];
  vx[k] = from.vx[lane], vy[k] = from.vy[lane], vz[k] = from.vz[lane];
  cos_v[k] = from.cos_v[lane];
  for (int c = 0; c < 3; ++c) albedo_over_pi[c][k] = from.albedo_over_pi[c][lane];
  specular[k] = from.specular[lane];
  alpha2[k] = from.alpha2[lane];
  target[k] = from.target[lane];
}

void HitRow::Add(const SurfaceHit& hit, Vec3 v, unsigned target, int channel) {
  if (blocks_.empty() || blocks_.back().count == 8) blocks_.emplace_back();
  HitBlock& b = blocks_.back();
  const int k = b.count++;
  const Vec3 p = hit.p + kLiftMm * hit.normal;
  b.x[k] = static_cast<float>(p.x);
  b.y[k] = static_cast<float>(p.y);
  b.z[k] = static_cast<float>(p.z);
  b.nx[k] = static_cast<float>(hit.normal.x);
  b.ny[k] = static_cast<float>(hit.normal.y);
  b.nz[k] = static_cast<float>(hit.normal.z);
  b.vx[k] = static_cast<float>(v.x);
  b.vy[k] = static_cast<float>(v.y);
  b.vz[k] = static_cast<float>(v.z);
  b.cos_v[k] = static_cast<float>(Dot(hit.normal, v));
  for (int c = 0; c < 3; ++c) {
    const int source = channel < 0 ? c : channel;
    b.albedo_over_pi[c][k] = static_cast<float>(hit.material.diffuse[source] / kPi);
  }
  b.specular[k] = static_cast<float>(hit.material.specular);
  const double alpha = std::clamp(hit.material.roughness, kMinRoughness, 1.0);
  b.alpha2[k] = static_cast<float>(alpha * alpha);
  b.target[k] = target;
}

void Illuminate(const World& world, const HitBlock& h, const Light& light, int channels,
                Response& response) {
  Geometry g;
  World::Rays8 rays;
  Aim(h, light, g, rays);
  int any = 0;
  for (int k = 0; k < 8; ++k) any |= rays.active[k];
  if (any != 0) world.Occluded(rays);
  alignas(32) float lobe[8], scale[8];
  for (int k = 0; k < 8; ++k) {
    const float lit = rays.active[k] != 0 && rays.occluded[k] == 0 ? 1.0f : 0.0f;
    // Half vector, unnormalised; sin^2 by the cross product, which keeps its digits near the peak.
    const float hx = g.lx[k] + h.vx[k], hy = g.ly[k] + h.vy[k], hz = g.lz[k] + h.vz[k];
    const float hh = hx * hx + hy * hy + hz * hz;
    const float nh = h.nx[k] * hx + h.ny[k] * hy + h.nz[k] * hz;
    const float cx = h.ny[k] * hz - h.nz[k] * hy, cy = h.nz[k] * hx - h.nx[k] * hz;
    const float cz = h.nx[k] * hy - h.ny[k] * hx;
    const float inverse = 1 / (hh > 1e-12f ? hh : 1e-12f);
    // Dark lanes get harmless cosines.
    const float cos_l = lit > 0 ? g.cos_l[k] : 1.0f, cos_v = lit > 0 ? h.cos_v[k] : 1.0f;
    const float alpha2 = lit > 0 ? h.alpha2[k] : 1.0f;
    lobe[k] = SpecularLobe(cos_l, cos_v, nh * nh * inverse, (cx * cx + cy * cy + cz * cz) * inverse,
                           h.specular[k], alpha2);
    scale[k] = lit * g.cos_l[k] * g.inverse_d2[k];
    lobe[k] = lit > 0 ? lobe[k] : 0.0f;
  }
  for (int c = 0; c < channels; ++c) {
    for (int k = 0; k < 8; ++k) {
      response.value[c][k] = (h.albedo_over_pi[c][k] + lobe[k]) * scale[k];
    }
  }
}

}  // namespace mesorig::world
