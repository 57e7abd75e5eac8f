#pragma once
// The subcommands of mesorig-sim. Each adds its options to `app` and returns what to run.

#include <functional>

#include "protocol/base/status.h"

namespace CLI {
class App;
}

namespace mesorig::simulator {

struct Command {
  CLI::App* app = nullptr;
  std::function<Status()> run;
};

Command AddTruthCommand(CLI::App& app);

}  // namespace mesorig::simulator
