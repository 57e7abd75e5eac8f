// mesorig: the operator's command line.

#include <CLI/CLI.hpp>
#include <vector>

#include "client/cli/commands.h"
#include "protocol/base/program.h"
#include "protocol/base/runtime_dir.h"

int main(int argc, char** argv) {
  using namespace mesorig;
  CLI::App app{
      "Runs and watches captures of mesorigd.\n"
      "A first session: mesorig plan check PLAN --rig RIG; mesorig run PLAN; mesorig status."};
  app.require_subcommand(1);
  app.fallthrough();
  client::Common common;
  common.runtime_dir = DefaultRuntimeDir().string();
  app.add_option("--runtime-dir", common.runtime_dir, "Where programs find each other")
      ->capture_default_str();
  auto* connect = app.add_option("--connect", common.connect,
                                 "HOST:PORT of a mesorigd over the network, by mutual TLS");
  auto* identity = app.add_option("--identity", common.identity,
                                  "Folder with key.pem, cert.pem, ca.pem (mesorig certs issue)");
  connect->needs(identity);
  app.add_flag("--json", common.json, "Print figures as JSON");
  CLI::App* plan = app.add_subcommand("plan", "Work on plan files without a daemon");
  plan->require_subcommand(1);
  plan->fallthrough();
  std::vector<client::Command> commands = {
      client::AddRunCommand(app, common),         client::AddStatusCommand(app, common),
      client::AddWatchCommand(app, common),       client::AddStopCommand(app, common),
      client::AddPauseCommand(app, common),       client::AddContinueCommand(app, common),
      client::AddAbortCommand(app, common),       client::AddArmCommand(app, common),
      client::AddStartCommand(app, common),       client::AddResetCommand(app, common),
      client::AddResumeCommand(app, common),      client::AddAcknowledgeCommand(app, common),
      client::AddSupportBundleCommand(app, common), client::AddPlanCheckCommand(*plan, common)};
  for (const auto add :
       {client::AddSessionCommands, client::AddCertsCommands, client::AddHandCommands,
        client::AddAuditCommands}) {
    for (auto& command : add(app, common)) commands.push_back(command);
  }
  return RunProgram(app, "mesorig", argc, argv, [&]() -> Status {
    for (const auto& command : commands) {
      if (command.app->parsed()) return command.run();
    }
    return InvalidArgument("no subcommand");
  });
}
