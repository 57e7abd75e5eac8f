#pragma once
// What the subcommands of mesorig-btf do with a mesostructure distance function (`*.mdf.exr`). Each
// prints its result to standard output, as text or as one JSON object.

#include <filesystem>

#include "protocol/base/status.h"

namespace mesorig::processing {

Status MdfInfo(const std::filesystem::path& file, bool json);

}  // namespace mesorig::processing
