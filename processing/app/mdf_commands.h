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

// The heights that one view shows, h_ref - D v.z, as grey: black is the turntable, white the
// reference plane, so that two files of one sample compare. Texels that were filled in (confidence
// 0) are red.
Status SliceMdf(const std::filesystem::path& mdf, int view, const std::filesystem::path& png,
                bool json);

}  // namespace mesorig::processing
