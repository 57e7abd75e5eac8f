#pragma once
// `mesorig-btf stripe`: how repeatable the line of a laser stripe is over photographs.

#include <array>
#include <filesystem>
#include <optional>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::processing {

struct StripeCommand {
  std::vector<std::filesystem::path> images;  // of one size
  std::optional<std::array<int, 4>> region;   // x, y, width, height; nothing: the whole image
  bool json = false;
};
// Prints position and angle of the line in each photograph and their scatter. InvalidArgument for a
// file that is no image or lacks the region; FailedPrecondition when no photograph shows a stripe.
Status FitStripes(const StripeCommand& command);

}  // namespace mesorig::processing
