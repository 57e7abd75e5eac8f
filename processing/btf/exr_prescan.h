#pragma once
// Internal to processing/btf.

#include <filesystem>

#include "protocol/base/status.h"

namespace mesorig::btf {

// Walks the headers of an OpenEXR file before the library sees them. OpenEXR allocates by the
// lengths that it reads; this refuses (InvalidArgument, naming the file) every attribute whose
// length exceeds the file, contradicts its type, or whose type the files of mesorig never hold.
Status PrescanExr(const std::filesystem::path& path);

}  // namespace mesorig::btf
