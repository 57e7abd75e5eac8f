#include <chrono>
#include <nlohmann/json.hpp>

#include "processing/app/btf_commands.h"
#include "processing/report/report.h"

namespace mesorig::processing {

Status Report(const std::filesystem::path& report_json, std::filesystem::path to, bool as_json) {
  const auto start = std::chrono::steady_clock::now();
  if (to.empty()) to = report_json.parent_path() / "report.html";
  MESORIG_ASSIGN_OR_RETURN(const report::ReportResult result, report::WriteReport(report_json, to));
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (as_json) {
    fmt::print("{}\n", nlohmann::json{{"file", to.string()},
                                      {"plots", result.plots},
                                      {"skipped", result.skipped},
                                      {"seconds", seconds}}
                           .dump(2));
    return OkStatus();
  }
  fmt::print("{}: {} plots, {:.2f} s\n", to.string(), result.plots.size(), seconds);
  for (const std::string& line : result.skipped) fmt::print("  skipped {}\n", line);
  return OkStatus();
}

}  // namespace mesorig::processing
