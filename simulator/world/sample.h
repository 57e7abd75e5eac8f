#pragma once
// Sample files (rigs/samples/*.toml): what lies on the turntable.

#include <filesystem>
#include <string>
#include <string_view>

#include "protocol/base/status.h"
#include "simulator/world/surface.h"

namespace mesorig::world {

struct Sample {
  Surface surface;
  double h_ref_mm = 0;      // a reference plane above its relief, as its plans should use
  std::string source_text;  // the TOML it was read from
  std::string sha256;       // of source_text
};

// NotFound, or InvalidArgument with file:line:column: unknown key, value out of range, reflectances
// whose sum exceeds 1, a relief that does not stay below h_ref_mm.
StatusOr<Sample> LoadSample(const std::filesystem::path& path);
StatusOr<Sample> ParseSample(std::string_view text, std::string_view name);

}  // namespace mesorig::world
