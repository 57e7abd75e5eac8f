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

// run: serves the simulated rig in a runtime directory until SIGINT or SIGTERM.
Command AddRunCommand(CLI::App& app);
// inject: a fault or an operator's hand, sent to a running simulator.
Command AddInjectCommand(CLI::App& app);
// truth: the exact values of a BTF.
Command AddTruthCommand(CLI::App& app);
Command AddBridgeCommand(CLI::App& app);

}  // namespace mesorig::simulator
