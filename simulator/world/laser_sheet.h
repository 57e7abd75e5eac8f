#pragma once
// What one camera at one pose sees of a line laser at one place while its sheet sweeps. The view's
// first hits are sorted once by the tilt whose sheet meets them; for a picture only those near the
// sheet are looked at, and each is lit (shadow ray, reflectance) when a sheet first comes near it
// and then serves all pictures of the sweep.
//
// The sheet at tilt t sends through a plane perpendicular to the ray from the source S
//
//   E(p) = power / (fan r) exp(-s^2 / (2 sigma^2)) / (sigma sqrt(2 pi)),   r = |p - S|,
//
// s being the distance of p from the sheet (SheetNormal) and sigma = fwhm / (2 sqrt(2 ln 2));
// nothing outside the fan and beyond kCutSigmas. Motion of the emitter during an exposure is not
// simulated. Sample frame, millimetres. Owned by one thread; the first hits are borrowed for each
// call.

#include <cstdint>
#include <span>
#include <vector>

#include "protocol/rig/rig.h"
#include "protocol/rig/rig_geometry.h"
#include "simulator/world/transport.h"
#include "simulator/world/world.h"

namespace mesorig::world {

// First hits of a camera's rays, one HitRow a row of pixels; targets are columns. The turntable's
// are kept apart, because lamps leave it black.
struct ViewHits {
  std::vector<HitRow> sample, turntable;
  int samples_per_pixel = 1;
};

class LaserSheet {
 public:
  static constexpr double kCutSigmas = 4;  // exp(-8) = 0.0003 of the peak

  LaserSheet(const Camera& camera, const Laser& laser, const LaserPose& pose_in_sample,
             const ViewHits& hits);

  // Whether a sheet at this tilt comes near hits that were not lit before.
  bool NeedsLight(double tilt_rad) const;
  // Lights them. `hits` must be those of the constructor. Returns how many there were.
  size_t LightUp(const World& world, const ViewHits& hits, double tilt_rad);
  // Adds `scale` times the radiance (W m^-2 sr^-1) to the region's pixels, row by row. What was not
  // lit is left out.
  void Add(double tilt_rad, double scale, const Region& region, std::span<float> pixels) const;

  size_t bytes() const { return hits_.size() * sizeof(Hit) + start_.size() * sizeof(uint32_t); }

 private:
  struct Hit {
    uint32_t pixel = 0;         // y * width + x
    uint32_t place = 0;         // in its row: block * 16 + lane * 2 + (1 on the turntable)
    float ahead = 0, deep = 0;  // mm: s = cos(t) ahead - sin(t) deep
    float peak = 0;             // radiance with the sheet's middle on it; once lit
  };
  struct Bins {
    size_t first = 0, last = 0;  // [first, last)
  };
  void Sort(std::vector<Hit> hits);
  Bins Near(double tilt_rad) const;

  const Camera& camera_;
  const Laser& laser_;
  const LaserPose pose_;
  const double sigma_mm_;
  double tilt_low_ = 0, bin_rad_ = 1, nearest_mm_ = 0;  // nearest: least distance from the axis
  std::vector<Hit> hits_;                               // bin by bin, in a bin in the order of rows
  std::vector<uint32_t> start_;                         // of each bin, and the end
  std::vector<uint8_t> lit_;                            // per bin
};

}  // namespace mesorig::world
