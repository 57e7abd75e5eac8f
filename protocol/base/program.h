#pragma once
// What every program's main has in common: --help, --version, exit codes, one line an error.

#include <functional>
#include <string_view>

#include "protocol/base/status.h"

namespace CLI {
class App;
}

namespace mesorig {

inline constexpr std::string_view kVersion = "0.1.0";

inline constexpr int kExitOk = 0, kExitFailed = 1, kExitUsage = 2;
// 2 for what the caller gave (InvalidArgument, NotFound, OutOfRange), 1 for every other failure.
int ExitCodeFor(const Status& status);

// Adds --version, parses, runs `run` and prints its error as one line `name: message` to stderr.
// Usage errors exit with 2. `app` has its options and subcommands; `run` is called after parsing.
int RunProgram(CLI::App& app, std::string_view name, int argc, char** argv,
               const std::function<Status()>& run);

}  // namespace mesorig
