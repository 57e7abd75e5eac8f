#pragma once
// One digest of everything in one of our EXR files that is measured or computed, and of nothing that
// tells how it came about: two captures of one plan can be compared by it.

#include <filesystem>
#include <string>

#include "protocol/base/status.h"

namespace mesorig::btf {

// XXH3-128, lower-case hexadecimal, over the parts in order: name, size, then each channel's name
// and values (as float; halves are exact in it). Attributes, provenance among them, do not count.
// NotFound; InvalidArgument for a file that is damaged or has lossy parts. Reads the whole file.
StatusOr<std::string> PixelDigest(const std::filesystem::path& path);

}  // namespace mesorig::btf
