#pragma once
// What one camera sees of one sweep, before any light: where its pixels look. Sample frame, mm.

#include <cstdint>
#include <span>
#include <vector>

#include "processing/mesostructure/stripe.h"
#include "protocol/plan/plan.h"
#include "protocol/rig/rig_geometry.h"

namespace mesorig::mesostructure {

// Immutable after Build; reentrant. Pixel k of the region is (k % width, k / width).
class SweepGeometry {
 public:
  // FailedPrecondition when the camera stands on or below the reference plane, looks along it, or
  // when the laser stands below the turntable. The rig must have laser, turntable, mount and
  // camera; the region lies within the sensor. `extent_mm`: side of the sample's square footprint.
  static StatusOr<SweepGeometry> Build(const Rig& rig, const Product& product, double extent_mm,
                                       int camera, int mount, std::span<const double> axis_rad,
                                       const Region& region);

  const Region& region() const { return region_; }
  Vec3 camera_position() const { return sample_from_camera_.translation; }
  Vec3 view() const { return view_; }  // nominal: from the centre of the reference plane
  const LaserPose& laser() const { return laser_; }
  // Across the stripe on the turntable, as this camera sees it.
  Profiles profiles() const { return profiles_; }
  // Unit direction of the ray through a point of the region (pixel (i, j)'s centre is (i + 1/2,
  // j + 1/2)).
  Vec3 Ray(ImagePoint in_region) const;
  // 1 where a pixel shows the turntable, and its ray does not touch the box of the sample on its
  // way (footprint by h_ref): the reference region.
  const std::vector<uint8_t>& reference() const { return reference_; }
  // Pixels whose rays cross the product's texels, ascending, of useful colours only.
  const std::vector<uint32_t>& sample() const { return sample_; }
  // Where the ray meets the plane at `z_mm`.
  Vec3 OnPlane(Vec3 ray, double z_mm) const;
  // Wang et al. 2005, Sec. 3.2: the volume of the tetrahedron of source, camera and two points of
  // the laser line through the turntable's centre, by the volume that the same distances would have
  // at right angles: |axis . (source x camera)| / (|source| |camera|), 0..1.
  double TetrahedronWeight() const;

 private:
  Camera camera_;
  RigidTransform sample_from_camera_;
  LaserPose laser_;
  Region region_;
  Vec3 view_;
  Profiles profiles_ = Profiles::kRows;
  std::vector<uint8_t> reference_;
  std::vector<uint32_t> sample_;
};

// Colours whose response to the laser is at least this share of the largest one are used: below, a
// pixel's noise outweighs what it tells.
inline constexpr double kLeastResponse = 0.2;
bool UsefulColour(const Laser& laser, int colour);

}  // namespace mesorig::mesostructure
