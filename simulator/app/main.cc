// mesorig-sim: the rig as a physical simulation behind the real device protocols.

#include <CLI/CLI.hpp>
#include <vector>

#include "protocol/base/program.h"
#include "simulator/app/commands.h"

int main(int argc, char** argv) {
  using namespace mesorig;
  CLI::App app{
      "The rig as a physical simulation behind the real device protocols. Start `mesorig-sim run`\n"
      "first, then mesorigd in the same runtime directory."};
  app.require_subcommand(1);
  const std::vector<simulator::Command> commands = {
      simulator::AddRunCommand(app), simulator::AddInjectCommand(app),
      simulator::AddBridgeCommand(app), simulator::AddTruthCommand(app)};
  return RunProgram(app, "mesorig-sim", argc, argv, [&]() -> Status {
    for (const auto& command : commands) {
      if (command.app->parsed()) return command.run();
    }
    return InvalidArgument("no subcommand");
  });
}
