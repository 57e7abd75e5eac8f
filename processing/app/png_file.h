#pragma once
// 8-bit RGB pictures for people.

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::processing {

struct Picture {
  int width = 0, height = 0;
  std::vector<uint8_t> rgb;  // row by row from the top
};

// Linear values times `exposure` as sRGB; with `code_values` only times 255 (they were encoded when
// photographed). Clipped; W*H*3 values.
Picture PictureOf(int width, int height, std::span<const float> linear, double exposure,
                  bool code_values);
// Both of one height; a dark column of two pixels between them.
Picture SideBySide(const Picture& left, const Picture& right);
Status WritePng(const Picture& picture, const std::filesystem::path& path);

}  // namespace mesorig::processing
