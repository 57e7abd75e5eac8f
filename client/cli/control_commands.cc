// status, watch, stop, acknowledge, sessions, pause, resume: one call each.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <vector>

#include "client/cli/commands.h"
#include "client/cli/text.h"
#include "client/connection/daemon_client.h"

namespace mesorig::client {
namespace {

Status ShowStatus(const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.runtime_dir));
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
  if (status.has_prompt()) fmt::print("{}\n", PromptText(status.prompt()));
  for (const v1::Reading& reading : status.readings()) {
    fmt::print("  {:<22} {:>12.4f} {:<4} {:.1f} s ago\n", reading.name(), reading.value(),
               reading.unit(), reading.age_s());
  }
  return OkStatus();
}

Status WatchEvents(const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.runtime_dir));
  return daemon->Watch(0, [&](const v1::Event& event) {
    fmt::print("{}\n", common.json ? JsonText(event) : EventText(event));
    std::fflush(stdout);
    return true;
  });
}

Status StopPlan(const Common& common, const std::string& reason) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.runtime_dir));
  return daemon->Stop(reason);
}

// The prompt that is waiting now.
Status Acknowledge(const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.runtime_dir));
  MESORIG_ASSIGN_OR_RETURN(const v1::StatusReply status, daemon->GetStatus());
  if (!status.has_prompt()) return FailedPrecondition("nothing is asked of the operator");
  return daemon->Acknowledge(status.prompt().id());
}

Status ShowSessions(const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.runtime_dir));
  MESORIG_ASSIGN_OR_RETURN(const auto sessions, daemon->ListSessions());
  if (common.json) fmt::print("{}\n", JsonText(sessions));
  for (const std::string& id : sessions.session_ids()) {
    if (common.json) continue;
    MESORIG_ASSIGN_OR_RETURN(const v1::SessionReply session, daemon->GetSession(id));
    fmt::print("{}  {}\n", id,
               !session.ended()     ? "open"
               : session.complete() ? "complete"
                                    : "incomplete");
  }
  return OkStatus();
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
            std::string reason;
            for (const std::string& word : *words) reason += (reason.empty() ? "" : " ") + word;
            return StopPlan(common, reason.empty() ? "operator" : reason);
          }};
}

Command AddAcknowledgeCommand(CLI::App& app, Common& common) {
  return {app.add_subcommand("acknowledge",
                             "The operator has done at the rig what the plan asks for; door and "
                             "reset at the rig are needed as well"),
          [&common] { return Acknowledge(common); }};
}

Command AddSessionsCommand(CLI::App& app, Common& common) {
  return {app.add_subcommand("sessions", "The daemon's sessions, oldest first"),
          [&common] { return ShowSessions(common); }};
}

Command AddPauseCommand(CLI::App& app, Common& common) {
  return {app.add_subcommand("pause", "Pause the running plan (not there yet)"),
          [&common]() -> Status {
            MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.runtime_dir));
            return daemon->Pause();
          }};
}

Command AddResumeCommand(CLI::App& app, Common& common) {
  return {app.add_subcommand("resume", "Resume a session (not there yet)"), [&common]() -> Status {
            MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.runtime_dir));
            return daemon->Resume();
          }};
}

}  // namespace mesorig::client
