#include "processing/image/image_file.h"

#include <algorithm>
#include <cctype>
#include <memory>

#include "protocol/base/file_writer.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wunused-function"
#define STBI_ONLY_TGA
#define STBI_ONLY_PNG
#define STBI_ONLY_JPEG
#define STBI_NO_STDIO
#define STBI_MAX_DIMENSIONS 16384
#define STB_IMAGE_STATIC
#define STB_IMAGE_IMPLEMENTATION
#include <stb/stb_image.h>
#pragma GCC diagnostic pop

namespace mesorig::image {
namespace {

constexpr size_t kMaxFileBytes = 512u << 20;
constexpr int kMaxSide = 16384;
constexpr double kMaxPixels = 2e8;

}  // namespace

bool IsImageName(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension == ".tga" || extension == ".png" || extension == ".jpg" || extension == ".jpeg";
}

StatusOr<Image8> DecodeImage8(std::string_view bytes, const std::string& file) {
  const auto* data = reinterpret_cast<const stbi_uc*>(bytes.data());
  const int size = static_cast<int>(bytes.size());
  Image8 image;
  int channels = 0;
  if (stbi_info_from_memory(data, size, &image.width, &image.height, &channels) == 0) {
    return InvalidArgument("{}: is not a TGA, PNG or JPEG image", file);
  }
  if (image.width < 1 || image.height < 1 || image.width > kMaxSide ||
      image.height > kMaxSide ||
      static_cast<double>(image.width) * image.height > kMaxPixels) {
    return InvalidArgument("{}: {} x {} pixels, each side must be in [1, {}]", file, image.width,
                           image.height, kMaxSide);
  }
  const std::unique_ptr<stbi_uc, void (*)(void*)> pixels(
      stbi_load_from_memory(data, size, &image.width, &image.height, &channels, 3),
      stbi_image_free);
  if (pixels == nullptr) return InvalidArgument("{}: damaged image", file);
  const size_t count = 3 * static_cast<size_t>(image.width) * static_cast<size_t>(image.height);
  image.rgb.assign(pixels.get(), pixels.get() + count);
  return image;
}

StatusOr<Image8> ReadImage(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxFileBytes));
  return DecodeImage8(bytes, path.string());
}

}  // namespace mesorig::image
