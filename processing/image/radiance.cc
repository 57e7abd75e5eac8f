#include "processing/image/radiance.h"

#include <algorithm>
#include <cmath>

namespace mesorig::image {
namespace {

double ElectronsPerDn(const Camera& camera) {
  return camera.full_well_e / (camera.white_dn() - camera.black_dn);
}

Status CheckBytes(const Camera& camera, size_t bytes) {
  if (bytes == camera.frame_bytes()) return OkStatus();
  return InvalidArgument("camera {}: a frame of {} bytes, {} x {} pixels of {} bits are {}",
                         camera.name, bytes, camera.width, camera.height, camera.bits,
                         camera.frame_bytes());
}

Status CheckCamera(const Camera& camera, double exposure_s) {
  if (!(exposure_s > 0) || !std::isfinite(exposure_s)) {
    return InvalidArgument("camera {}: exposure of {} s is not positive", camera.name, exposure_s);
  }
  if (camera.black_dn < 0 || camera.black_dn >= camera.white_dn()) {
    return InvalidArgument("camera {}: black level {} is not in [0, {})", camera.name,
                           camera.black_dn, camera.white_dn());
  }
  const double scale = ElectronsPerDn(camera) / (camera.electrons_per_radiance_s * exposure_s);
  if (!(scale > 0) || !std::isfinite(static_cast<float>(scale * camera.white_dn()))) {
    return InvalidArgument("camera {}: full well of {} e and {} e per radiance and s in {} s give "
                           "no finite radiance",
                           camera.name, camera.full_well_e, camera.electrons_per_radiance_s,
                           exposure_s);
  }
  return OkStatus();
}

int CodeAt(std::string_view bytes, size_t pixel, bool two_bytes) {
  const auto byte = [&](size_t i) { return static_cast<int>(static_cast<uint8_t>(bytes[i])); };
  return two_bytes ? byte(2 * pixel) | byte(2 * pixel + 1) << 8 : byte(pixel);
}

Status CodeAboveWhite(const Camera& camera, int code, size_t pixel) {
  return InvalidArgument("camera {}: code value {} at column {}, row {} is above {}", camera.name,
                         code, pixel % static_cast<size_t>(camera.width),
                         pixel / static_cast<size_t>(camera.width), camera.white_dn());
}

}  // namespace

int ColourAt(BayerPattern pattern, int column, int row) {
  if (pattern == BayerPattern::kMono) return 1;
  return (column & 1) + (row & 1);  // red green / green blue
}

int SaturationMarginDn(const Camera& camera) {
  return 1 + static_cast<int>(std::ceil(4 * camera.read_noise_e / ElectronsPerDn(camera)));
}

StatusOr<MosaicImage> LinearRadiance(const Camera& camera, std::string_view bytes,
                                     double exposure_s, std::span<const float> black_dn) {
  MESORIG_RETURN_IF_ERROR(CheckBytes(camera, bytes.size()));
  MESORIG_RETURN_IF_ERROR(CheckCamera(camera, exposure_s));
  MosaicImage image{camera.width, camera.height, camera.pattern, {}, {}};
  const size_t pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  if (!black_dn.empty() && black_dn.size() != pixels) {
    return InvalidArgument("camera {}: {} black levels of {} pixels", camera.name, black_dn.size(),
                           pixels);
  }
  image.radiance.resize(pixels);
  const double scale = ElectronsPerDn(camera) / (camera.electrons_per_radiance_s * exposure_s);
  const int white = camera.white_dn(), clipped = white - SaturationMarginDn(camera);
  const bool two_bytes = camera.bytes_per_pixel() == 2;
  for (size_t i = 0; i < pixels; ++i) {
    const int code = CodeAt(bytes, i, two_bytes);
    if (code > white) return CodeAboveWhite(camera, code, i);
    if (code >= clipped) {
      if (image.saturated.empty()) image.saturated.resize(pixels);
      image.saturated[i] = 1;
    }
    const double black = black_dn.empty() ? camera.black_dn : static_cast<double>(black_dn[i]);
    image.radiance[i] = static_cast<float>((code - black) * scale);
  }
  return image;
}

Status ReadCodes(const Camera& camera, std::string_view bytes, std::span<float> codes) {
  MESORIG_RETURN_IF_ERROR(CheckBytes(camera, bytes.size()));
  const size_t pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  if (codes.size() != pixels) {
    return InvalidArgument("camera {}: room for {} codes of {} pixels", camera.name, codes.size(),
                           pixels);
  }
  const bool two_bytes = camera.bytes_per_pixel() == 2;
  for (size_t i = 0; i < pixels; ++i) {
    const int code = CodeAt(bytes, i, two_bytes);
    if (code > camera.white_dn()) return CodeAboveWhite(camera, code, i);
    codes[i] = static_cast<float>(code);
  }
  return OkStatus();
}

double RadianceVariance(const Camera& camera, double radiance, double exposure_s) {
  const double electrons_per_radiance = camera.electrons_per_radiance_s * exposure_s;
  const double q = ElectronsPerDn(camera);
  const double electrons = std::max(0.0, radiance) * electrons_per_radiance;
  return (electrons + camera.read_noise_e * camera.read_noise_e + q * q / 12) /
         (electrons_per_radiance * electrons_per_radiance);
}

}  // namespace mesorig::image
