// bench_soak [--days N] --json FILE --dir DIR: a virtual week at the daemon; README.md.

#include <CLI/CLI.hpp>
#include <filesystem>

#include "protocol/base/file_writer.h"
#include "protocol/base/log.h"
#include "protocol/base/program.h"
#include "tests/daemon/soak/soak.h"

namespace mesorig {
namespace {

Status Run(const std::string& dir, const std::string& json, double days) {
  StartLogging("bench_soak");
  MESORIG_RETURN_IF_ERROR(SetLogging({"off", LogFormat::kText}));  // faults are many, and meant
  const auto root = std::filesystem::path(dir) / "soak";
  std::error_code error;
  std::filesystem::remove_all(root, error);
  daemon::SoakOptions options;
  options.virtual_s = days * 86400;
  const daemon::SoakReport report = daemon::RunSoak(root, options);
  std::filesystem::remove_all(root, error);
  fmt::print("{}", report.Text());
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(json, report.Json()));
  if (!report.violations.empty()) return DataLoss("{} violations", report.violations.size());
  return OkStatus();
}

}  // namespace
}  // namespace mesorig

int main(int argc, char** argv) {
  CLI::App app{"A virtual week of sessions with faults, stops, lease changes and consumer restarts"};
  std::string dir, json;
  double days = 7;
  app.add_option("--days", days, "Virtual days")->capture_default_str();
  app.add_option("--dir", dir, "Where sessions are written")->required();
  app.add_option("--json", json, "The report")->required();
  return mesorig::RunProgram(app, "bench_soak", argc, argv,
                             [&] { return mesorig::Run(dir, json, days); });
}
