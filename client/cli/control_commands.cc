// status, watch, and the commands to the state machine: one call each.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <memory>
#include <vector>

#include "client/cli/commands.h"
#include "client/cli/text.h"
#include "client/connection/daemon_client.h"

namespace mesorig::client {
namespace {

constexpr double kWatchPatience_s = 60;  // for a daemon that is gone

Status ShowStatus(const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
  MESORIG_ASSIGN_OR_RETURN(const v1::StatusReply status, daemon->GetStatus());
  if (common.json) {
    fmt::print("{}\n", JsonText(status));
    return OkStatus();
  }
  fmt::print("{} on rig {}: {}{}{}\n", daemon->hello().server(), daemon->hello().rig_name(),
             StateName(status.state()), status.message().empty() ? "" : ", ", status.message());
  if (!status.session_id().empty()) {
    fmt::print("session {}: {} of {} shots, {} of {} frames durable, {} of about {}\n",
               status.session_id(), status.shots_done(), status.shots(), status.frames_durable(),
               status.frames(), DurationText(status.rig_s()), DurationText(status.estimated_s()));
  }
  if (status.bytes_left() > 0) {
    fmt::print("  about {} to go, {} to come, {} free on the disk{}\n",
               DurationText(status.remaining_s()), BytesText(status.bytes_left()),
               BytesText(status.disk_free_bytes()),
               status.disk_free_bytes() < status.bytes_left() ? ": it will not fit" : "");
  }
  if (status.alarms() > 0) fmt::print("  {} alarms: see `mesorig watch`\n", status.alarms());
  if (!status.storage().empty()) fmt::print("  the disk takes nothing: {}\n", status.storage());
  if (status.lease().kind() != v1::LEASE_FREE) fmt::print("  {}\n", LeaseText(status.lease()));
  if (!status.manual().empty()) fmt::print("  by hand: {}\n", status.manual());
  if (!status.audit_trouble().empty()) fmt::print("  audit log: {}\n", status.audit_trouble());
  if (status.has_prompt()) fmt::print("{}\n", PromptText(status.prompt()));
  for (const v1::Reading& reading : status.readings()) {
    fmt::print("  {:<22} {:>12.4f} {:<6} {:.1f} s ago{}\n", reading.name(), reading.value(),
               reading.unit(), reading.age_s(),
               reading.source() == v1::COMMANDED ? ", as commanded" : "");
  }
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
  return {app.add_subcommand("status", "What the daemon does, and what it read back from the rig"),
          [&common] { return ShowStatus(common); }};
}

Command AddWatchCommand(CLI::App& app, Common& common) {
  return {app.add_subcommand("watch", "Events as they happen, until Ctrl-C"),
          [&common] { return WatchEvents(common); }};
}

Command AddStopCommand(CLI::App& app, Common& common) {
  auto words = std::make_shared<std::vector<std::string>>();
  CLI::App* stop =
      app.add_subcommand("stop", "Lamps off and axes stopped, now; the session ends incomplete");
  stop->add_option("reason", *words, "Why, for the journal");
  return {stop, [words, &common] {
            return Order(common, [&](DaemonClient& daemon) { return daemon.Stop(Joined(*words)); });
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
