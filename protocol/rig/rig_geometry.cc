#include "protocol/rig/rig_geometry.h"

#include <algorithm>
#include <cmath>

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

LaserPose LaserInWorld(const Rig& rig, int mount, std::span<const double> axis_rad) {
  MESORIG_CHECK(rig.laser.has_value());
  const LaserMount& m = rig.laser->mounts[mount];
  const RigidTransform world_from_frame = WorldFromFrame(rig, rig.laser->frame, axis_rad);
  const Vec3 towards = DirectionFromAngles(m.theta_rad, 0);
  return {world_from_frame * (m.distance_mm * towards), world_from_frame.rotation * Vec3{0, 1, 0},
          world_from_frame.rotation * -towards};
}

LaserPose LaserInSample(const Rig& rig, int mount, std::span<const double> axis_rad) {
  const LaserPose world = LaserInWorld(rig, mount, axis_rad);
  const RigidTransform sample_from_world = Inverse(WorldFromSample(rig, axis_rad));
  return {sample_from_world * world.source, sample_from_world.rotation * world.axis,
          sample_from_world.rotation * world.forward};
}

Vec3 SheetNormal(const LaserPose& pose, double tilt_rad) {
  const Vec3 normal = Cross(pose.axis, pose.forward);
  return std::cos(tilt_rad) * normal - std::sin(tilt_rad) * pose.forward;
}

double TiltOfPoint(const LaserPose& pose, Vec3 p) {
  const Vec3 d = p - pose.source;
  return std::atan2(Dot(d, Cross(pose.axis, pose.forward)), Dot(d, pose.forward));
}

std::optional<ImagePoint> Project(const Camera& camera, Vec3 p) {
  if (!(p.z > 1e-6)) return std::nullopt;
  return ImagePoint{camera.focal_px * p.x / p.z + camera.cx,
                    camera.focal_px * p.y / p.z + camera.cy};
}

std::optional<Region> RegionOfDisc(const Rig& rig, int camera, std::span<const double> axis_rad,
                                   double radius_mm, double height_mm) {
  constexpr int kPoints = 72;
  const Camera& c = rig.cameras[camera];
  const RigidTransform camera_from_sample = Inverse(SampleFromCamera(rig, camera, axis_rad));
  double u0 = c.width, v0 = c.height, u1 = 0, v1 = 0;
  for (int i = 0; i < 2 * kPoints; ++i) {
    const double phi = 2 * kPi * (i % kPoints) / kPoints;
    const Vec3 p{radius_mm * std::cos(phi), radius_mm * std::sin(phi), i < kPoints ? 0 : height_mm};
    const auto seen = Project(c, camera_from_sample * p);
    if (!seen) return std::nullopt;
    u0 = std::min(u0, seen->u);
    u1 = std::max(u1, seen->u);
    v0 = std::min(v0, seen->v);
    v1 = std::max(v1, seen->v);
  }
  const auto even = [](double at, int size) {
    return static_cast<int>(std::clamp(at, 0.0, static_cast<double>(size))) / 2 * 2;
  };
  const int x = even(u0, c.width), y = even(v0, c.height);
  const Region region{x, y, even(u1 + 2, c.width) - x, even(v1 + 2, c.height) - y};
  if (region.width <= 0 || region.height <= 0) return std::nullopt;
  return region;
}

Vec3 RayDirection(const Camera& camera, ImagePoint point) {
  return Normalized(
      {(point.u - camera.cx) / camera.focal_px, (point.v - camera.cy) / camera.focal_px, 1});
}

namespace {

// Frames and solids are at most a few metres: this is far below a micrometre.
constexpr int kSearchSteps = 40;

// Least value of a convex function on [low, high].
template <typename F>
double LeastOfConvex(double low, double high, const F& f) {
  constexpr double kGolden = 0.61803398874989485;
  double x1 = high - kGolden * (high - low), x2 = low + kGolden * (high - low);
  double f1 = f(x1), f2 = f(x2);
  double least = std::min({f(low), f(high), f1, f2});
  for (int i = 0; i < kSearchSteps; ++i) {
    if (f1 < f2) {
      high = x2, x2 = x1, f2 = f1;
      x1 = high - kGolden * (high - low), f1 = f(x1);
    } else {
      low = x1, x1 = x2, f1 = f2;
      x2 = low + kGolden * (high - low), f2 = f(x2);
    }
    least = std::min({least, f1, f2});
  }
  return least;
}

// All segments from a disc to a point: a cone whose base need not stand square to its axis.
struct Bundle {
  Vec3 centre, normal;  // of the disc
  double radius = 0;    // mm
  Vec3 apex;
};

double DistanceToDisc(Vec3 p, Vec3 centre, Vec3 normal, double radius) {
  const Vec3 d = p - centre;
  const double height = Dot(d, normal);
  const double outside = std::max(0.0, Norm(d - height * normal) - radius);
  return std::hypot(height, outside);
}

// Distance of the segment a-b from the bundle's part between the disc and the fraction `until` of
// the way to the apex. The bundle is convex and its cross-sections parallel to the disc are discs:
// both one-dimensional searches are over convex functions.
double BundleDistance(const Bundle& bundle, double until, Vec3 a, Vec3 b) {
  return LeastOfConvex(0, until, [&](double s) {
    const Vec3 centre = bundle.centre + s * (bundle.apex - bundle.centre);
    const double radius = (1 - s) * bundle.radius;
    return LeastOfConvex(0, 1, [&](double t) {
      return DistanceToDisc(a + t * (b - a), centre, bundle.normal, radius);
    });
  });
}

bool Blocks(const Bundle& bundle, Vec3 a, Vec3 b, double radius) {
  const double length = Norm(bundle.apex - bundle.centre);
  double until = 1;
  if (SegmentDistance(a, b, bundle.apex, bundle.apex) <= radius) {  // it holds the point itself
    until = 1 - (2 * radius + 1e-9) / length;
    if (until <= 0) return false;
  }
  const Vec3 end = bundle.centre + until * (bundle.apex - bundle.centre);
  const double from_axis = SegmentDistance(a, b, bundle.centre, end);
  if (from_axis >= radius + bundle.radius) return false;  // the quick answers
  if (from_axis < radius) return true;
  // Written so that a position that is not a number counts as blocked.
  return !(BundleDistance(bundle, until, a, b) >= radius);
}

}  // namespace

std::optional<std::string> BlockedBy(const Rig& rig, Vec3 p_in_world,
                                     std::span<const double> axis_rad) {
  const RigidTransform world_from_sample = WorldFromSample(rig, axis_rad);
  const Bundle bundle{world_from_sample.translation, world_from_sample.rotation * Vec3{0, 0, 1},
                      rig.sample_radius_mm, p_in_world};
  if (bundle.apex == bundle.centre) return std::nullopt;
  for (const Solid& solid : rig.solids) {
    const RigidTransform world_from_solid = WorldFromFrame(rig, solid.frame, axis_rad);
    const Vec3 a = world_from_solid * solid.a_in_frame, b = world_from_solid * solid.b_in_frame;
    if (Blocks(bundle, a, b, solid.radius_mm)) return solid.name;
  }
  return std::nullopt;
}

}  // namespace mesorig
