#include "protocol/rig/rig_geometry.h"

#include <algorithm>

#include "protocol/base/check.h"

namespace mesorig {

RigidTransform WorldFromFrame(const Rig& rig, int frame, std::span<const double> axis_rad) {
  MESORIG_CHECK(axis_rad.size() == rig.axes.size());
  RigidTransform world_from_frame;
  for (int f = frame; f >= 0; f = rig.frames[f].parent) {
    const Frame& link = rig.frames[f];
    RigidTransform parent_from_link{{}, link.translation_mm};
    if (link.axis >= 0) {
      parent_from_link.rotation = RotationAbout(link.axis_direction, axis_rad[link.axis]);
    }
    world_from_frame = parent_from_link * world_from_frame;
  }
  return world_from_frame;
}

RigidTransform WorldFromSample(const Rig& rig, std::span<const double> axis_rad) {
  return WorldFromFrame(rig, rig.FindFrame("sample").value(), axis_rad);
}

RigidTransform WorldFromCamera(const Rig& rig, int camera, std::span<const double> axis_rad) {
  return WorldFromFrame(rig, rig.cameras[camera].frame, axis_rad) *
         rig.cameras[camera].frame_from_camera;
}

Vec3 LampInWorld(const Rig& rig, int lamp, std::span<const double> axis_rad) {
  return WorldFromFrame(rig, rig.lamps[lamp].frame, axis_rad) * rig.lamps[lamp].p_in_frame;
}

RigidTransform SampleFromCamera(const Rig& rig, int camera, std::span<const double> axis_rad) {
  return Inverse(WorldFromSample(rig, axis_rad)) * WorldFromCamera(rig, camera, axis_rad);
}

Vec3 LampInSample(const Rig& rig, int lamp, std::span<const double> axis_rad) {
  return Inverse(WorldFromSample(rig, axis_rad)) * LampInWorld(rig, lamp, axis_rad);
}

std::optional<ImagePoint> Project(const Camera& camera, Vec3 p) {
  if (!(p.z > 1e-6)) return std::nullopt;
  return ImagePoint{camera.focal_px * p.x / p.z + camera.cx,
                    camera.focal_px * p.y / p.z + camera.cy};
}

Vec3 RayDirection(const Camera& camera, ImagePoint point) {
  return Normalized(
      {(point.u - camera.cx) / camera.focal_px, (point.v - camera.cy) / camera.focal_px, 1});
}

std::optional<std::string> BlockedBy(const Rig& rig, Vec3 p_in_world,
                                     std::span<const double> axis_rad) {
  const RigidTransform world_from_sample = WorldFromSample(rig, axis_rad);
  const Vec3 centre = world_from_sample.translation;
  const double length = Norm(p_in_world - centre);
  if (!(length > 0)) return std::nullopt;
  const Vec3 to_point = (1 / length) * (p_in_world - centre);
  for (const Solid& solid : rig.solids) {
    const RigidTransform world_from_solid = WorldFromFrame(rig, solid.frame, axis_rad);
    const Vec3 a = world_from_solid * solid.a_in_frame, b = world_from_solid * solid.b_in_frame;
    // The bundle of rays from the disc to the point narrows linearly towards the point; its radius
    // at half way bounds a capsule test that is exact for the two ends' mean. Beams are thin
    // (a sample of 20 mm at 900 mm), so the bundle is taken as a cylinder of the disc's radius
    // scaled by the solid's place along it.
    Vec3 end = p_in_world;
    if (SegmentDistance(a, b, p_in_world, p_in_world) <= solid.radius_mm) {
      const double own = 2 * solid.radius_mm + 1e-9;  // its own mount
      if (own >= length) continue;
      end = p_in_world - own * to_point;
    }
    const double along =
        std::min(Dot(a - centre, to_point), Dot(b - centre, to_point)) / length;
    const double bundle = rig.sample_radius_mm * std::clamp(1 - along, 0.0, 1.0);
    if (SegmentDistance(a, b, centre, end) < solid.radius_mm + bundle) return solid.name;
  }
  return std::nullopt;
}

}  // namespace mesorig
