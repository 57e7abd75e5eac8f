#pragma once
// What the lamps send to each texel. Reentrant.

#include <span>
#include <vector>

#include "processing/btf/sampled_btf.h"
#include "protocol/base/status.h"
#include "protocol/rig/rig.h"

namespace mesorig::assemble {

// Of the light at the centre of the reference plane, what all other lamps together may send. A
// value of the BTF has one light direction; this much from elsewhere changes it by less than the
// camera's noise, and is counted as light.
inline constexpr double kMaxStrayShare = 1e-3;

struct Illumination {
  int lamp = -1;          // the one that shines
  Vec3 lamp_in_sample;    // mm
  // Irradiance of a plane perpendicular to the light, W m^-2, 3 values a texel:
  //   E = sum over lamps of level * intensity / d^2, d in metres from the lamp to the texel.
  std::vector<float> irradiance;
};

// axis_rad and lamp_level: as read back, one per axis and lamp of the rig. FailedPrecondition when
// no lamp shines, more than one does, the lamp stands on or below the reference plane, or one of
// its colours is dark.
StatusOr<Illumination> IlluminationAt(const Rig& rig, std::span<const double> axis_rad,
                                      std::span<const double> lamp_level,
                                      const btf::BtfHeader& grid);

}  // namespace mesorig::assemble
