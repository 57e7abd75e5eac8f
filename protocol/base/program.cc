#include "protocol/base/program.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

namespace mesorig {

int ExitCodeFor(const Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kOk:
      return kExitOk;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kOutOfRange:
      return kExitUsage;
    default:
      return kExitFailed;
  }
}

int RunProgram(CLI::App& app, std::string_view name, int argc, char** argv,
               const std::function<Status()>& run) {
  app.set_version_flag("--version", fmt::format("{} {}", name, kVersion));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitOk : kExitUsage;
  }
  Status status;
  try {
    status = run();
  } catch (const std::exception& error) {  // a library's exception that its wrapper missed
    status = Internal("{}", error.what());
  }
  if (!status.ok()) {
    fmt::print(stderr, "{}: {}{}\n", name,
               absl::IsUnimplemented(status) ? "UNIMPLEMENTED: " : "",
               Message(status));
  }
  return ExitCodeFor(status);
}

}  // namespace mesorig
