#pragma once
// Which of our files a path names.

#include <filesystem>

#include "protocol/base/status.h"

namespace mesorig::btf {

enum class FileKind { kBtf, kMdf };
// By the attribute `format` of part 0, never by the name. NotFound, or InvalidArgument for what is
// no EXR file or none of ours; names the file.
StatusOr<FileKind> ReadFileKind(const std::filesystem::path& path);

}  // namespace mesorig::btf
