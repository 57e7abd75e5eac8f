#pragma once
// Small pictures of frames, for the eye.

#include <cstdint>
#include <string>

#include "daemon/session/session.h"

namespace mesorig::daemon {

inline constexpr int kMaxPreviewWidth = 160;

struct PreviewImage {
  int width = 0, height = 0;
  std::string grey;  // 8 bits, linear, rows from the top
};

// Means over squares of an even number of pixels (whole Bayer quads), so that the picture is at
// most kMaxPreviewWidth wide; what is left over at the right and below is cut. Empty for a frame
// smaller than a square, or with fewer pixels than its record says.
PreviewImage MakePreview(const FrameRecord& record, const std::string& pixels);

}  // namespace mesorig::daemon
