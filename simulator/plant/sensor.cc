#include "simulator/plant/sensor.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "protocol/base/bytes.h"
#include "protocol/base/digest.h"
#include "simulator/plant/philox.h"
#include "simulator/plant/read_noise.h"

namespace mesorig::plant {
namespace {

// 128 bits that stand for the key: two words key the generator, two go into its counter.
std::array<uint32_t, 4> WordsOf(const NoiseKey& key) {
  ByteWriter bytes;
  bytes.Put(key.seed).PutString(key.camera_serial);
  bytes.Put(static_cast<uint32_t>(key.axis_counts.size()));
  for (int64_t counts : key.axis_counts) bytes.Put(counts);
  bytes.Put(static_cast<uint32_t>(key.lamp_levels.size()));
  for (double level : key.lamp_levels) bytes.Put(level + 0.0);  // -0 is 0
  bytes.Put(key.laser_level + 0.0).Put(key.laser_tilt_rad + 0.0);
  bytes.Put(key.exposure_us).Put(key.gain).Put(key.repeat_index);
  const std::string digest = FrameDigest(bytes.bytes());
  std::array<uint32_t, 4> words{};
  for (size_t i = 0; i < 4; ++i) {
    words[i] = static_cast<uint32_t>(std::stoul(digest.substr(8 * i, 8), nullptr, 16));
  }
  return words;
}

Status Check(const Camera& camera, const Region& region, std::span<const float> expected_e,
             const NoiseKey& key) {
  if (region.x < 0 || region.y < 0 || region.width <= 0 || region.height <= 0 ||
      region.width > camera.width - region.x || region.height > camera.height - region.y) {
    return InvalidArgument("{}: a region of {} x {} at ({}, {}) is not within {} x {}", camera.name,
                           region.width, region.height, region.x, region.y, camera.width,
                           camera.height);
  }
  if (expected_e.size() != static_cast<size_t>(region.width) * static_cast<size_t>(region.height)) {
    return InvalidArgument("{}: {} expected electrons for {} x {} pixels", camera.name,
                           expected_e.size(), region.width, region.height);
  }
  if (!(key.gain > 0 && key.gain <= 1000)) {
    return InvalidArgument("{}: gain {} is not in (0, 1000]", camera.name, key.gain);
  }
  return OkStatus();
}

}  // namespace

StatusOr<std::string> ReadOut(const Camera& camera, const Region& region,
                              std::span<const float> expected_e, const NoiseKey& key) {
  MESORIG_RETURN_IF_ERROR(Check(camera, region, expected_e, key));
  const auto words = WordsOf(key);
  std::vector<float> normal(static_cast<size_t>(region.width));
  const double white = camera.white_dn();
  const double dn_per_e = key.gain * (white - camera.black_dn) / camera.full_well_e;
  const int bytes_per_pixel = camera.bytes_per_pixel();
  std::string bytes(expected_e.size() * static_cast<size_t>(bytes_per_pixel), '\0');
  char* out = bytes.data();
  size_t i = 0;
  for (int y = region.y; y < region.y + region.height; ++y) {
    const auto first = static_cast<uint32_t>(y * camera.width + region.x);
    FillNormal(words, first, normal);
    for (uint32_t k = 0; k < normal.size(); ++k, ++i) {
      const double expected = expected_e[i];
      if (!(expected >= 0 && std::isfinite(expected))) {
        return InvalidArgument("{}: pixel {} expects {} electrons", camera.name, i, expected);
      }
      double electrons = camera.read_noise_e * normal[k];
      if (expected > 0) {
        PhiloxStream random({words[0], words[1]}, first + k, words[2], words[3]);
        // A pixel far beyond its well is full whatever its noise; the cut bounds the arithmetic.
        const double mean = std::min(expected, 4 * camera.full_well_e + 1000);
        electrons += std::min(static_cast<double>(random.Poisson(mean)), camera.full_well_e);
      }
      const double code =
          std::clamp(std::floor(camera.black_dn + dn_per_e * electrons + 0.5), 0.0, white);
      const auto dn = static_cast<uint16_t>(code);
      *out++ = static_cast<char>(dn & 0xff);
      if (bytes_per_pixel == 2) *out++ = static_cast<char>(dn >> 8);
    }
  }
  return bytes;
}

}  // namespace mesorig::plant
