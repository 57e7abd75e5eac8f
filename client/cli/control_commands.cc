// status, watch, and the commands to the state machine: one call each.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <memory>
#include <vector>

#include "client/cli/commands.h"
#include "client/cli/status_screen.h"
#include "client/cli/text.h"
#include "client/connection/daemon_client.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/wire/stop_line.h"

namespace mesorig::client {
namespace {

constexpr double kWatchPatience_s = 60;  // for a daemon that is gone

constexpr size_t kEventsLooked = 400;

// What happened but for progress, which the screen shows anyhow.
std::vector<v1::Event> NewsOf(DaemonClient& daemon, const v1::StatusReply& status) {
  std::vector<v1::Event> events = daemon.LastEvents(status, kEventsLooked);
  std::erase_if(events, [](const v1::Event& event) { return event.has_progress(); });
  return events;
}

Status ShowStatus(const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
  MESORIG_ASSIGN_OR_RETURN(const v1::StatusReply status, daemon->GetStatus());
  if (common.json) {
    fmt::print("{}\n", JsonText(status));
    return OkStatus();
  }
  fmt::print("{}", StatusScreen(daemon->hello(), status, NewsOf(*daemon, status)));
  return OkStatus();
}

// May the programs be replaced? OK when no session is under way, or no daemon runs.
Status ShowIdle(const Common& common) {
  const auto endpoint = FindEndpoint(common.runtime_dir, "mesorigd");
  if (common.connect.empty() && !endpoint.ok()) {
    fmt::print("idle: {}\n", Message(endpoint.status()));
    return OkStatus();
  }
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
  MESORIG_ASSIGN_OR_RETURN(const v1::StatusReply status, daemon->GetStatus());
  if (status.state() != v1::IDLE && status.state() != v1::FAULT) {
    return FailedPrecondition("{}, session {}: {} of {} shots, about {} to go",
                              StateName(status.state()), status.session_id(), status.shots_done(),
                              status.shots(), DurationText(status.remaining_s()));
  }
  if (!status.manual().empty()) return FailedPrecondition("by hand: {}", status.manual());
  fmt::print("idle\n");
  return OkStatus();
}

Status WatchEvents(const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
  return daemon->Watch(
      0,
      [&](const v1::Event& event) {
        fmt::print("{}\n", common.json ? JsonText(event) : EventText(event));
        std::fflush(stdout);
        return true;
      },
      kWatchPatience_s);
}

// One command to the daemon; with --json what it does then.
Status Order(const Common& common, const std::function<Status(DaemonClient&)>& give) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
  MESORIG_RETURN_IF_ERROR(give(*daemon));
  if (!common.json) return OkStatus();
  MESORIG_ASSIGN_OR_RETURN(const v1::StatusReply status, daemon->GetStatus());
  fmt::print("{}\n", JsonText(status));
  return OkStatus();
}

std::string Joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text.empty() ? "operator" : text;
}

// The prompt that is waiting now.
Status Acknowledge(const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
  MESORIG_ASSIGN_OR_RETURN(const v1::StatusReply status, daemon->GetStatus());
  if (!status.has_prompt()) return FailedPrecondition("nothing is asked of the operator");
  return daemon->Acknowledge(status.prompt().id());
}

}  // namespace

Command AddStatusCommand(CLI::App& app, Common& common) {
  auto idle = std::make_shared<bool>(false);
  CLI::App* status =
      app.add_subcommand("status", "What the daemon does, and what it read back from the rig");
  status->add_flag("--idle", *idle,
                   "Exit 0 when no session is under way, so that programs may be replaced; else 1");
  return {status, [idle, &common] { return *idle ? ShowIdle(common) : ShowStatus(common); }};
}

Command AddWatchCommand(CLI::App& app, Common& common) {
  return {app.add_subcommand("watch", "Events as they happen, until Ctrl-C"),
          [&common] { return WatchEvents(common); }};
}

// By the daemon's own channel for it; over the network, and where there is none, as any call.
Status StopRig(const Common& common, const std::string& reason) {
  if (common.connect.empty()) {
    const Status off = wire::SayStop(wire::StopSocket(common.runtime_dir), reason);
    if (!off.ok() && !absl::IsNotFound(off)) return off;
    if (off.ok() && !common.json) return off;
  }
  return Order(common, [&](DaemonClient& daemon) { return daemon.Stop(reason); });
}

Command AddStopCommand(CLI::App& app, Common& common) {
  auto words = std::make_shared<std::vector<std::string>>();
  CLI::App* stop =
      app.add_subcommand("stop", "Lamps off and axes stopped, now; the session ends incomplete");
  stop->add_option("reason", *words, "Why, for the journal");
  return {stop, [words, &common] {
            return StopRig(common, Joined(*words));
          }};
}

Command AddAcknowledgeCommand(CLI::App& app, Common& common) {
  return {app.add_subcommand("acknowledge",
                             "The operator has done at the rig what the plan asks for; door and "
                             "reset at the rig are needed as well"),
          [&common] { return Acknowledge(common); }};
}

Command AddPauseCommand(CLI::App& app, Common& common) {
  struct Options {
    std::vector<std::string> words;
    bool now = false;
  };
  auto options = std::make_shared<Options>();
  CLI::App* pause = app.add_subcommand(
      "pause", "Everything off after the shot or sweep under way; `mesorig continue` goes on");
  pause->add_option("reason", options->words, "Why, for the journal");
  pause->add_flag("--now", options->now, "Do not wait for the shot: it is taken again");
  return {pause, [options, &common] {
            return Order(common, [&](DaemonClient& daemon) {
              return daemon.Pause(options->now, Joined(options->words));
            });
          }};
}

Command AddContinueCommand(CLI::App& app, Common& common) {
  return {app.add_subcommand("continue", "Go on after a pause"), [&common] {
            return Order(common, [](DaemonClient& daemon) { return daemon.Continue(); });
          }};
}

Command AddAbortCommand(CLI::App& app, Common& common) {
  auto words = std::make_shared<std::vector<std::string>>();
  CLI::App* abort = app.add_subcommand(
      "abort", "Lamps and laser off, axes parked at home; the session ends incomplete");
  abort->add_option("reason", *words, "Why, for the journal");
  return {abort, [words, &common] {
            return Order(common,
                         [&](DaemonClient& daemon) { return daemon.Abort(Joined(*words)); });
          }};
}

Command AddResetCommand(CLI::App& app, Common& common) {
  return {app.add_subcommand("reset", "Leave a fault"),
          [&common] { return Order(common, [](DaemonClient& daemon) { return daemon.Reset(); }); }};
}

Command AddStartCommand(CLI::App& app, Common& common) {
  return {app.add_subcommand("start", "Begin the plan that is armed"),
          [&common] { return Order(common, [](DaemonClient& daemon) { return daemon.Start(); }); }};
}

}  // namespace mesorig::client
