#pragma once
// Finished pictures.

#include <cstdint>
#include <filesystem>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::renderer {

// 8-bit sRGB, RGB interleaved, rows from the top.
struct Picture {
  int width = 0, height = 0;
  std::vector<uint8_t> rgb;
};

// The file is whole or absent. InvalidArgument when the folder does not exist or cannot be written
// or the name does not end in .png; Unavailable when the disk refuses.
Status WritePng(const Picture& picture, const std::filesystem::path& path);

}  // namespace mesorig::renderer
