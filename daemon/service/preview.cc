#include "daemon/service/preview.h"

#include <algorithm>

namespace mesorig::daemon {

PreviewImage MakePreview(const FrameRecord& record, const std::string& pixels) {
  PreviewImage image;
  const int square =
      2 * std::max(1, (record.width + 2 * kMaxPreviewWidth - 1) / (2 * kMaxPreviewWidth));
  const size_t bytes_per_pixel = record.bits > 8 ? 2 : 1;
  const auto width = static_cast<size_t>(std::max(0, record.width));
  if (record.width < square || record.height < square || record.bits < 1 || record.bits > 16 ||
      pixels.size() < width * static_cast<size_t>(record.height) * bytes_per_pixel) {
    return image;
  }
  image.width = record.width / square;
  image.height = record.height / square;
  image.grey.resize(static_cast<size_t>(image.width) * static_cast<size_t>(image.height));
  const auto value = [&](size_t x, size_t y) -> uint64_t {
    const size_t at = (y * width + x) * bytes_per_pixel;
    const auto low = static_cast<uint8_t>(pixels[at]);
    return bytes_per_pixel == 1
               ? low
               : low | static_cast<uint64_t>(static_cast<uint8_t>(pixels[at + 1])) << 8;
  };
  const auto side = static_cast<size_t>(square);
  const uint64_t full = ((uint64_t{1} << record.bits) - 1) * side * side;
  for (size_t j = 0; j < static_cast<size_t>(image.height); ++j) {
    for (size_t i = 0; i < static_cast<size_t>(image.width); ++i) {
      uint64_t sum = 0;
      for (size_t y = 0; y < side; ++y) {
        for (size_t x = 0; x < side; ++x) sum += value(i * side + x, j * side + y);
      }
      const uint64_t grey = std::min<uint64_t>(255, (sum * 255 + full / 2) / full);
      image.grey[j * static_cast<size_t>(image.width) + i] = static_cast<char>(grey);
    }
  }
  return image;
}

}  // namespace mesorig::daemon
