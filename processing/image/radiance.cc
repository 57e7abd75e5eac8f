#include "processing/image/radiance.h"

#include <cmath>

namespace mesorig::image {
namespace {

double ElectronsPerDn(const Camera& camera) {
  return camera.full_well_e / (camera.white_dn() - camera.black_dn);
}

Status CheckCamera(const Camera& camera, size_t bytes, double exposure_s) {
  if (bytes != camera.frame_bytes()) {
    return InvalidArgument("camera {}: a frame of {} bytes, {} x {} pixels of {} bits are {}",
                           camera.name, bytes, camera.width, camera.height, camera.bits,
                           camera.frame_bytes());
  }
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

}  // namespace

int ColourAt(BayerPattern pattern, int column, int row) {
  if (pattern == BayerPattern::kMono) return 1;
  return (column & 1) + (row & 1);  // red green / green blue
}

int SaturationMarginDn(const Camera& camera) {
  return 1 + static_cast<int>(std::ceil(4 * camera.read_noise_e / ElectronsPerDn(camera)));
}

StatusOr<MosaicImage> LinearRadiance(const Camera& camera, std::string_view bytes,
                                     double exposure_s) {
  MESORIG_RETURN_IF_ERROR(CheckCamera(camera, bytes.size(), exposure_s));
  MosaicImage image{camera.width, camera.height, camera.pattern, {}, {}};
  const size_t pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  image.radiance.resize(pixels);
  const double scale = ElectronsPerDn(camera) / (camera.electrons_per_radiance_s * exposure_s);
  const int white = camera.white_dn(), clipped = white - SaturationMarginDn(camera);
  const bool two_bytes = camera.bytes_per_pixel() == 2;
  for (size_t i = 0; i < pixels; ++i) {
    const int code = CodeAt(bytes, i, two_bytes);
    if (code > white) {
      return InvalidArgument("camera {}: code value {} at column {}, row {} is above {}",
                             camera.name, code, i % static_cast<size_t>(camera.width),
                             i / static_cast<size_t>(camera.width), white);
    }
    if (code >= clipped) {
      if (image.saturated.empty()) image.saturated.resize(pixels);
      image.saturated[i] = 1;
    }
    image.radiance[i] = static_cast<float>((code - camera.black_dn) * scale);
  }
  return image;
}

}  // namespace mesorig::image
