#include "processing/mesostructure/sweep_geometry.h"

#include <algorithm>
#include <cmath>

#include "processing/image/radiance.h"
#include "protocol/base/check.h"

namespace mesorig::mesostructure {
namespace {

constexpr double kLeastViewZ = 0.01;  // as CheckMdfHeader

// Whether the segment a-b meets the square |x|, |y| <= half (slabs).
bool MeetsSquare(Vec3 a, Vec3 b, double half) {
  double enter = 0, leave = 1;
  const double from[2] = {a.x, a.y}, way[2] = {b.x - a.x, b.y - a.y};
  for (int k = 0; k < 2; ++k) {
    if (way[k] == 0) {  // along a slab: inside it all the way, or never
      if (std::abs(from[k]) > half) return false;
      continue;
    }
    const double t0 = (-half - from[k]) / way[k], t1 = (half - from[k]) / way[k];
    enter = std::max(enter, std::min(t0, t1)), leave = std::min(leave, std::max(t0, t1));
  }
  return enter <= leave;
}

}  // namespace

bool UsefulColour(const Laser& laser, int colour) {
  const double largest = *std::max_element(laser.response.begin(), laser.response.end());
  const double response = laser.response[static_cast<size_t>(colour)];
  return response > 0 && response >= kLeastResponse * largest;
}

Vec3 SweepGeometry::Ray(ImagePoint in_region) const {
  return sample_from_camera_.rotation *
         RayDirection(camera_, {in_region.u + region_.x, in_region.v + region_.y});
}

Vec3 SweepGeometry::OnPlane(Vec3 ray, double z_mm) const {
  const Vec3 c = camera_position();
  return c + ((z_mm - c.z) / ray.z) * ray;
}

double SweepGeometry::TetrahedronWeight() const {
  const Vec3 c = camera_position();
  const double scale = Norm(laser_.source) * Norm(c);
  return scale > 0 ? std::abs(Dot(laser_.axis, Cross(laser_.source, c))) / scale : 0;
}

StatusOr<SweepGeometry> SweepGeometry::Build(const Rig& rig, const Product& product,
                                             double extent_mm, int camera, int mount,
                                             std::span<const double> axis_rad,
                                             const Region& region) {
  MESORIG_CHECK(rig.laser.has_value() && rig.turntable.has_value());
  SweepGeometry g;
  g.camera_ = rig.cameras[static_cast<size_t>(camera)];
  g.sample_from_camera_ = SampleFromCamera(rig, camera, axis_rad);
  g.laser_ = LaserInSample(rig, mount, axis_rad);
  g.region_ = region;
  g.view_ = Normalized(g.camera_position() - Vec3{0, 0, product.h_ref_mm});
  if (!(g.view_.z >= kLeastViewZ)) {
    return FailedPrecondition(
        "camera {} looks along the reference plane: v.z is {:.4f}, at least {}", g.camera_.name,
        g.view_.z, kLeastViewZ);
  }
  if (!(g.laser_.source.z > product.h_ref_mm)) {
    return FailedPrecondition("mount {} stands at z = {:.1f} mm, the reference plane at {} mm",
                              rig.laser->mounts[static_cast<size_t>(mount)].name, g.laser_.source.z,
                              product.h_ref_mm);
  }
  const double margin = 0.5 * rig.laser->fwhm_mm;
  const double half = 0.5 * extent_mm + margin;
  const double disc = rig.turntable->radius_mm - margin;
  const double right = 0.5 * product.width_px * product.pitch_mm + product.pitch_mm;
  const double top = 0.5 * product.height_px * product.pitch_mm + product.pitch_mm;
  g.reference_.assign(static_cast<size_t>(region.width) * static_cast<size_t>(region.height), 0);
  for (int j = 0; j < region.height; ++j) {
    for (int i = 0; i < region.width; ++i) {
      if (!UsefulColour(*rig.laser, image::ColourAt(g.camera_.pattern, i, j))) continue;
      const Vec3 ray = g.Ray({i + 0.5, j + 0.5});
      if (!(ray.z < -1e-3)) continue;  // looks up, or so flat that it meets no plane
      const Vec3 low = g.OnPlane(ray, 0), high = g.OnPlane(ray, product.h_ref_mm);
      const auto pixel = static_cast<uint32_t>(j * region.width + i);
      if (std::hypot(low.x, low.y) <= disc && !MeetsSquare(high, low, half)) {
        g.reference_[pixel] = 1;
      }
      if (std::abs(high.x) <= right && std::abs(high.y) <= top) g.sample_.push_back(pixel);
    }
  }
  const RigidTransform camera_from_sample = Inverse(g.sample_from_camera_);
  const auto a = Project(g.camera_, camera_from_sample * Vec3{0, 0, 0});
  const auto b = Project(g.camera_, camera_from_sample * g.laser_.axis);
  if (a && b && std::abs(b->u - a->u) > std::abs(b->v - a->v)) g.profiles_ = Profiles::kColumns;
  return g;
}

}  // namespace mesorig::mesostructure
