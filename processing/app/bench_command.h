#pragma once
// `mesorig-btf bench`: all codecs over their settings on one BTF.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::processing {

struct BenchCommand {
  std::filesystem::path from;
  std::vector<std::string> codecs;            // none: all
  std::optional<std::filesystem::path> out;   // folder for bench.html, bench.json, plots, pictures
  int most_terms = 64;
  bool clamp_negative = false;                // as EncodeOptions
  std::vector<double> error_limits;           // of the recommendation; none: the report's own
  std::vector<std::filesystem::path> materials;  // other BTFs: RMS error against terms alone
  bool json = false;
};
// Prints a table, or one JSON object. InvalidArgument for a codec that there is not or one that cannot
// encode this BTF at any setting, when it was asked for by name.
Status Bench(const BenchCommand& command);

}  // namespace mesorig::processing
