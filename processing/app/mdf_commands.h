#pragma once
// What the subcommands of mesorig-btf do with a mesostructure distance function (`*.mdf.exr`). Each
// prints its result to standard output, as text or as one JSON object.

#include <filesystem>

#include "protocol/base/status.h"

namespace mesorig::processing {

Status MdfInfo(const std::filesystem::path& file, bool json);

// Errors of D over the views within 60 degrees (processing/btf/mdf_errors.h). by_angle: also per
// ring of views.
Status CompareMdfFiles(const std::filesystem::path& mdf, const std::filesystem::path& truth,
                       bool by_angle, bool json);

}  // namespace mesorig::processing
