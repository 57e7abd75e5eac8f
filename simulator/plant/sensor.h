#pragma once
// From expected electrons to the bytes of a frame: shot noise, full well, read noise, gain, black
// level, quantisation.
//
//   electrons = min(Poisson(expected), full_well) + read_noise * N(0, 1)
//   code      = round(black + gain * electrons * (white - black) / full_well), clamped to 0..white
//
// so that at gain 1 full_well_e gives the largest code value. 8 bits travel in one byte, 12 bits in
// two, little-endian. Each pixel of the sensor has its own noise, so that a region's frame is the
// crop of the whole sensor's, byte for byte. Reentrant.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/rig/rig.h"

namespace mesorig::plant {

// What a frame's noise depends on: equal keys give equal bytes, in any order and on any number of
// threads; repeats differ by their index.
struct NoiseKey {
  uint64_t seed = 0;
  std::string camera_serial;
  std::vector<int64_t> axis_counts;  // commanded
  std::vector<double> lamp_levels;   // commanded, 0..1
  double laser_level = 0;            // share of the exposure during which the laser shone
  double laser_tilt_rad = 0;         // of the emitter; 0 when it did not shine
  uint32_t exposure_us = 0;
  double gain = 1;
  uint32_t repeat_index = 0;
};

// expected_e: electrons of the region's pixels, row by row. InvalidArgument when the region is not
// within the sensor, their number is not the region's, one is negative or not finite, or gain is
// not in (0, 1000].
StatusOr<std::string> ReadOut(const Camera& camera, const Region& region,
                              std::span<const float> expected_e, const NoiseKey& key);

}  // namespace mesorig::plant
