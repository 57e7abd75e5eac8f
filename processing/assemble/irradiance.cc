#include "processing/assemble/irradiance.h"

#include <algorithm>

#include "protocol/base/check.h"
#include "protocol/rig/rig_geometry.h"

namespace mesorig::assemble {
namespace {

constexpr double kMetresPerMm = 1e-3;

// Of one lamp at full level, summed over the colours: only to compare lamps with each other.
double Strength(const Lamp& lamp, Vec3 lamp_in_sample, Vec3 p_in_sample) {
  const Vec3 d = kMetresPerMm * (lamp_in_sample - p_in_sample);
  return (lamp.intensity_w_sr[0] + lamp.intensity_w_sr[1] + lamp.intensity_w_sr[2]) / Dot(d, d);
}

// The lamp that shines, or why there is no such one.
StatusOr<int> OnlyLamp(const Rig& rig, std::span<const Vec3> lamps,
                       std::span<const double> lamp_level, Vec3 centre) {
  double total = 0, strongest = 0;
  int lamp = -1;
  for (size_t k = 0; k < rig.lamps.size(); ++k) {
    const double share = std::max(0.0, lamp_level[k]) * Strength(rig.lamps[k], lamps[k], centre);
    total += share;
    if (share > strongest) strongest = share, lamp = static_cast<int>(k);
  }
  if (lamp < 0) return FailedPrecondition("no lamp shines");
  if (total - strongest > kMaxStrayShare * total) {
    return FailedPrecondition("lamp {} gives {:.1f} % of the light, at least {:.1f} % is needed",
                              rig.lamps[static_cast<size_t>(lamp)].name, 100 * strongest / total,
                              100 * (1 - kMaxStrayShare));
  }
  return lamp;
}

void AddLamp(const Lamp& lamp, Vec3 lamp_in_sample, double level, const btf::BtfHeader& grid,
             std::vector<double>& sums) {
  size_t texel = 0;
  for (int j = 0; j < grid.height; ++j) {
    for (int i = 0; i < grid.width; ++i, ++texel) {
      const Vec3 d = kMetresPerMm * (lamp_in_sample - grid.TexelCentre(i, j));
      const double factor = level / Dot(d, d);
      for (size_t c = 0; c < 3; ++c) sums[3 * texel + c] += factor * lamp.intensity_w_sr[c];
    }
  }
}

}  // namespace

StatusOr<Illumination> IlluminationAt(const Rig& rig, std::span<const double> axis_rad,
                                      std::span<const double> lamp_level,
                                      const btf::BtfHeader& grid) {
  MESORIG_CHECK(lamp_level.size() == rig.lamps.size());
  std::vector<Vec3> lamps;
  for (size_t k = 0; k < rig.lamps.size(); ++k) {
    lamps.push_back(LampInSample(rig, static_cast<int>(k), axis_rad));
  }
  Illumination light;
  MESORIG_ASSIGN_OR_RETURN(light.lamp, OnlyLamp(rig, lamps, lamp_level, {0, 0, grid.h_ref_mm}));
  const Lamp& only = rig.lamps[static_cast<size_t>(light.lamp)];
  light.lamp_in_sample = lamps[static_cast<size_t>(light.lamp)];
  if (!(light.lamp_in_sample.z > grid.h_ref_mm)) {
    return FailedPrecondition("lamp {} stands at z = {} mm, the reference plane at {} mm",
                              only.name, light.lamp_in_sample.z, grid.h_ref_mm);
  }
  for (const double intensity : only.intensity_w_sr) {
    if (!(intensity > 0)) return FailedPrecondition("lamp {} lacks a colour", only.name);
  }
  std::vector<double> sums(3 * grid.texel_count(), 0.0);
  for (size_t k = 0; k < rig.lamps.size(); ++k) {
    if (lamp_level[k] > 0) AddLamp(rig.lamps[k], lamps[k], lamp_level[k], grid, sums);
  }
  light.irradiance.assign(sums.begin(), sums.end());
  return light;
}

}  // namespace mesorig::assemble
