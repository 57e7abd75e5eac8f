#pragma once
// Where everything is at given axis positions. `axis_rad` holds one angle per Rig::axes.

#include <optional>
#include <span>
#include <vector>

#include "protocol/rig/rig.h"

namespace mesorig {

// frame -1 is the world.
RigidTransform WorldFromFrame(const Rig& rig, int frame, std::span<const double> axis_rad);
RigidTransform WorldFromSample(const Rig& rig, std::span<const double> axis_rad);
RigidTransform WorldFromCamera(const Rig& rig, int camera, std::span<const double> axis_rad);
Vec3 LampInWorld(const Rig& rig, int lamp, std::span<const double> axis_rad);

// In the sample frame: what BTF directions are made of.
RigidTransform SampleFromCamera(const Rig& rig, int camera, std::span<const double> axis_rad);
Vec3 LampInSample(const Rig& rig, int lamp, std::span<const double> axis_rad);

// The laser's pencil of planes (docs/laser.md): every sheet contains the line through `source`
// along `axis`; `forward` is the beam's middle at tilt 0. `axis` x `forward` is the sheet's normal
// at tilt 0; positive tilt turns the beam away from the foot of the source. Unit vectors.
struct LaserPose {
  Vec3 source, axis, forward;
};
// The rig must have a laser and this mount.
LaserPose LaserInWorld(const Rig& rig, int mount, std::span<const double> axis_rad);
LaserPose LaserInSample(const Rig& rig, int mount, std::span<const double> axis_rad);
// Unit normal of the sheet at this tilt: Dot(normal, p - source) is the signed distance of p from
// it, mm, positive ahead, where greater tilts go.
Vec3 SheetNormal(const LaserPose& pose, double tilt_rad);
// The tilt whose sheet passes through p, in (-pi, pi]; 0 for a point on the axis itself, which
// every sheet contains.
double TiltOfPoint(const LaserPose& pose, Vec3 p);

// Image coordinates (pixel centres at half-integers) of a point in the camera frame. Nothing for a
// point that is not in front of the camera (z <= 0, or so near that the division overflows).
struct ImagePoint {
  double u = 0, v = 0;
};
std::optional<ImagePoint> Project(const Camera& camera, Vec3 p_in_camera);
// Unit direction, in the camera frame, of the ray through (u, v).
Vec3 RayDirection(const Camera& camera, ImagePoint point);

// The pixels of a camera that see a disc of `radius_mm` around the sample frame's origin, on the
// turntable and `height_mm` above it, within the sensor; even origin and size. Nothing when they
// miss the sensor or part of the disc is behind the camera.
std::optional<Region> RegionOfDisc(const Rig& rig, int camera, std::span<const double> axis_rad,
                                   double radius_mm, double height_mm);

// The name of a solid that stands between the sample's disc (radius Rig::sample_radius_mm around
// its origin, parallel to its xy plane) and `p_in_world`, or nothing: the exact distance of the
// solid from the cone of all segments between them. A solid that holds `p_in_world` itself (a
// camera's own arc, a lamp's own housing) does not count within its own thickness of the point.
// Axis angles that are not finite count as blocked.
std::optional<std::string> BlockedBy(const Rig& rig, Vec3 p_in_world,
                                     std::span<const double> axis_rad);

}  // namespace mesorig
