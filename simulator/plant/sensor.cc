#include "simulator/plant/sensor.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/bytes.h"
#include "protocol/base/digest.h"
#include "simulator/plant/philox.h"

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
  bytes.Put(key.exposure_us).Put(key.gain).Put(key.repeat_index);
  const std::string digest = FrameDigest(bytes.bytes());
  std::array<uint32_t, 4> words{};
  for (size_t i = 0; i < 4; ++i) {
    words[i] = static_cast<uint32_t>(std::stoul(digest.substr(8 * i, 8), nullptr, 16));
  }
  return words;
}

}  // namespace

StatusOr<std::string> ReadOut(const Camera& camera, std::span<const float> expected_e,
                              const NoiseKey& key) {
  const size_t pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  if (expected_e.size() != pixels) {
    return InvalidArgument("{}: {} expected electrons for {} pixels", camera.name,
                           expected_e.size(), pixels);
  }
  if (!(key.gain > 0 && key.gain <= 1000)) {
    return InvalidArgument("{}: gain {} is not in (0, 1000]", camera.name, key.gain);
  }
  const auto words = WordsOf(key);
  const double white = camera.white_dn();
  const double dn_per_e = key.gain * (white - camera.black_dn) / camera.full_well_e;
  std::string bytes(camera.frame_bytes(), '\0');
  for (size_t i = 0; i < pixels; ++i) {
    const double expected = expected_e[i];
    if (!(expected >= 0 && std::isfinite(expected))) {
      return InvalidArgument("{}: pixel {} expects {} electrons", camera.name, i, expected);
    }
    PhiloxStream random({words[0], words[1]}, static_cast<uint32_t>(i), words[2], words[3]);
    // A pixel far beyond its well is full whatever its noise; the cut bounds the arithmetic.
    const double mean = std::min(expected, 4 * camera.full_well_e + 1000);
    const double electrons =
        std::min(static_cast<double>(random.Poisson(mean)), camera.full_well_e) +
        camera.read_noise_e * random.Gaussian();
    const double code =
        std::clamp(std::floor(camera.black_dn + dn_per_e * electrons + 0.5), 0.0, white);
    const auto dn = static_cast<uint16_t>(code);
    if (camera.bytes_per_pixel() == 1) {
      bytes[i] = static_cast<char>(dn);
    } else {
      bytes[2 * i] = static_cast<char>(dn & 0xff);
      bytes[2 * i + 1] = static_cast<char>(dn >> 8);
    }
  }
  return bytes;
}

}  // namespace mesorig::plant
