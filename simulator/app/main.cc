// mesorig-sim: the rig as a physical simulation behind the real device protocols.

#include <CLI/CLI.hpp>
#include <vector>

#include "protocol/base/program.h"
#include "simulator/app/commands.h"

int main(int argc, char** argv) {
  using namespace mesorig;
  CLI::App app{"Simulates the rig: its sample, its optics and its devices."};
  app.require_subcommand(1);
  const std::vector<simulator::Command> commands = {simulator::AddTruthCommand(app)};
  return RunProgram(app, "mesorig-sim", argc, argv, [&]() -> Status {
    for (const auto& command : commands) {
      if (command.app->parsed()) return command.run();
    }
    return InvalidArgument("no subcommand");
  });
}
