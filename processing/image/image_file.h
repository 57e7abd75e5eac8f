#pragma once
// 8-bit photographs: TGA, PNG, JPEG.

#include <cstdint>
#include <filesystem>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::image {

struct Image8 {
  int width = 0, height = 0;
  std::vector<uint8_t> rgb;  // row by row from the top
};

bool IsImageName(const std::filesystem::path& path);
// InvalidArgument names the file: unreadable, not an image, larger than 16384 pixels a side.
StatusOr<Image8> ReadImage(const std::filesystem::path& path);
// The same from bytes; `file` is for messages.
StatusOr<Image8> DecodeImage8(std::string_view bytes, const std::string& file);

}  // namespace mesorig::image
