#pragma once
// The report of a run for people: report.json (docs/report.md) to report.html with plots.

#include <filesystem>
#include <string>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::report {

struct ReportResult {
  std::vector<std::string> plots;    // file names, beside the page
  std::vector<std::string> skipped;  // what is not on the page, and why
};

// Writes `html` and its plots beside it, whole or not at all each. Pictures are linked relative to
// the page, which must lie in the folder of `report_json` (InvalidArgument). NotFound or
// InvalidArgument, with the place, for a file that cannot be read or is no JSON object. What is
// missing in it is skipped and said.
StatusOr<ReportResult> WriteReport(const std::filesystem::path& report_json,
                                   const std::filesystem::path& html);

}  // namespace mesorig::report
