#include "processing/app/png_file.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/check.h"
#include "protocol/base/file_writer.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#pragma GCC diagnostic ignored "-Wunused-function"
#define STB_IMAGE_WRITE_STATIC
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STBI_WRITE_NO_STDIO
#include <stb/stb_image_write.h>
#pragma GCC diagnostic pop

namespace mesorig::processing {
namespace {

constexpr int kGap = 2;

double SrgbFromLinear(double x) {  // IEC 61966-2-1
  return x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
}

}  // namespace

Picture PictureOf(int width, int height, std::span<const float> linear, double exposure,
                  bool code_values) {
  Picture picture{width, height, std::vector<uint8_t>(linear.size())};
  for (size_t i = 0; i < linear.size(); ++i) {
    const double value = std::clamp(linear[i] * exposure, 0.0, 1.0);
    picture.rgb[i] =
        static_cast<uint8_t>(std::lround(255 * (code_values ? value : SrgbFromLinear(value))));
  }
  return picture;
}

Picture SideBySide(const Picture& left, const Picture& right) {
  MESORIG_CHECK(left.height == right.height);
  Picture both{left.width + kGap + right.width, left.height, {}};
  for (int y = 0; y < both.height; ++y) {
    const auto row = [y](const Picture& p) {
      return p.rgb.begin() + static_cast<std::ptrdiff_t>(3) * y * p.width;
    };
    both.rgb.insert(both.rgb.end(), row(left), row(left) + 3 * left.width);
    both.rgb.insert(both.rgb.end(), 3 * kGap, uint8_t{24});
    both.rgb.insert(both.rgb.end(), row(right), row(right) + 3 * right.width);
  }
  return both;
}

Status WritePng(const Picture& picture, const std::filesystem::path& path) {
  std::string bytes;
  const auto append = [](void* context, void* data, int size) {
    static_cast<std::string*>(context)->append(static_cast<const char*>(data),
                                               static_cast<size_t>(size));
  };
  if (stbi_write_png_to_func(append, &bytes, picture.width, picture.height, 3, picture.rgb.data(),
                             3 * picture.width) == 0) {
    return Internal("{}: the picture cannot be encoded", path.string());
  }
  return WriteFileAtomically(path, bytes);
}

}  // namespace mesorig::processing
