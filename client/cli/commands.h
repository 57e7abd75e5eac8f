#pragma once
// The subcommands of mesorig. Each adds its options to `app` and returns what to run.

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/wire/channel.h"

namespace CLI {
class App;
}

namespace mesorig::client {

// Options that every subcommand shares, filled in by parsing.
struct Common {
  std::string runtime_dir;
  std::string connect;   // HOST:PORT of a daemon over the network; empty: the local one
  std::string identity;  // folder of the user's key and certificate, for it
  wire::Address daemon() const {
    wire::Address address(runtime_dir);
    address.host_port = connect;
    address.identity = identity;
    return address;
  }
  bool json = false;
};

struct Command {
  CLI::App* app = nullptr;
  std::function<Status()> run;
};

Command AddRunCommand(CLI::App& app, Common& common);
Command AddSupportBundleCommand(CLI::App& app, Common& common);
Command AddStatusCommand(CLI::App& app, Common& common);
Command AddWatchCommand(CLI::App& app, Common& common);
Command AddStopCommand(CLI::App& app, Common& common);
Command AddAcknowledgeCommand(CLI::App& app, Common& common);
Command AddArmCommand(CLI::App& app, Common& common);
Command AddStartCommand(CLI::App& app, Common& common);
// sessions, session ..., preview
std::vector<Command> AddSessionCommands(CLI::App& app, Common& common);
// lease ..., jog, axis, lamp, laser
std::vector<Command> AddHandCommands(CLI::App& app, Common& common);
// audit ...
std::vector<Command> AddAuditCommands(CLI::App& app, Common& common);
Command AddPauseCommand(CLI::App& app, Common& common);
Command AddContinueCommand(CLI::App& app, Common& common);
Command AddAbortCommand(CLI::App& app, Common& common);
Command AddResetCommand(CLI::App& app, Common& common);
Command AddResumeCommand(CLI::App& app, Common& common);
// certs init, issue, revoke, list, token
std::vector<Command> AddCertsCommands(CLI::App& app, Common& common);
Command AddPlanCheckCommand(CLI::App& plan, Common& common);

}  // namespace mesorig::client
