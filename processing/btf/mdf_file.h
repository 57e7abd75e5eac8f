#pragma once
// `*.mdf.exr`: multi-part OpenEXR that ordinary viewers open (DESIGN, "Files"). Part 0 is a preview
// picture and alone carries the attributes; parts V000... hold one view each: `D` (float, mm) and
// `C` (confidence, half). A file is whole or absent.

#include <filesystem>

#include "processing/btf/mdf.h"

namespace mesorig::btf {

inline constexpr int kMdfFormatMajor = 1, kMdfFormatMinor = 0;

struct MdfFileInfo {
  MdfHeader header;
  uint64_t file_bytes = 0;
};

// InvalidArgument names the file and what is wrong (not an EXR, not a mesorig MDF, a newer major
// version, an attribute that is missing or out of range); never a crash on hostile bytes.
StatusOr<MdfFileInfo> ReadMdfInfo(const std::filesystem::path& path);
// Distances that are NaN, infinite or negative and confidences that are NaN, negative or beyond
// half's range are refused (InvalidArgument).
Status WriteMdf(const Mdf& mdf, const std::filesystem::path& path);
StatusOr<Mdf> ReadMdf(const std::filesystem::path& path);

}  // namespace mesorig::btf
