// sessions, session verify | journal | remove | clean | export, preview.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <vector>

#include "client/cli/commands.h"
#include "client/cli/session_export.h"
#include "client/cli/text.h"
#include "client/connection/frames_client.h"
#include "protocol/base/file_writer.h"
#include "protocol/rig/rig.h"

namespace mesorig::client {
namespace {

using Client = std::unique_ptr<FramesClient>;

std::string AgeText(double seconds) {
  constexpr double kDay = 24 * 3600;
  return seconds < 2 * kDay ? DurationText(seconds) : fmt::format("{:.0f} days", seconds / kDay);
}

Status ShowSessions(const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const Client daemon, FramesClient::Connect(common.daemon()));
  MESORIG_ASSIGN_OR_RETURN(const auto reply, daemon->ListSessions());
  if (common.json) {
    fmt::print("{}\n", JsonText(reply));
    return OkStatus();
  }
  uint64_t bytes = 0;
  for (const v1::SessionInfo& s : reply.sessions()) {
    bytes += s.bytes();
    fmt::print("{}  {:<10} {} of {} frames, {}, written {} ago{}{}\n", s.session_id(), s.state(),
               s.frames_durable(), s.frames_planned(), BytesText(s.bytes()), AgeText(s.age_s()),
               s.reason().empty() ? "" : ": ", s.reason());
  }
  fmt::print("{} sessions, {}; {} free\n", reply.sessions_size(), BytesText(bytes),
             BytesText(reply.disk_free_bytes()));
  return OkStatus();
}

std::string EntryText(const v1::JournalEntry& entry) {
  return fmt::format("{:12.3f} s  {:<10}{}{}{}{}", entry.rig_s(), entry.kind(),
                     entry.index() < 0 ? "" : fmt::format(" {}", entry.index()),
                     entry.value() == 0 ? "" : fmt::format(" {:g}", entry.value()),
                     entry.text().empty() ? "" : "  ", entry.text());
}

Status Verify(const Common& common, const std::string& id) {
  MESORIG_ASSIGN_OR_RETURN(const Client daemon, FramesClient::Connect(common.daemon()));
  StatusOr<v1::VerifyReport> report = Internal("not asked");
  {
    ProgressBar bar;
    report = daemon->Verify(
        id, [&](uint32_t done, uint32_t frames) { bar.Show(done, frames, "frames"); });
  }
  MESORIG_RETURN_IF_ERROR(report.status());
  if (common.json) {
    fmt::print("{}\n", JsonText(*report));
  } else {
    const v1::SessionInfo& s = report->session();
    fmt::print("{}, {}: {} planned frames, {} live of {} rows, {} read again{}\n", s.session_id(),
               s.state(), s.frames_planned(), report->frames_live(), report->rows(),
               BytesText(report->bytes_read()),
               report->frames_released() == 0
                   ? ""
                   : fmt::format(", {} released", report->frames_released()));
    fmt::print("content {}\n", report->content_digest());
    fmt::print("journal: {} starts, {} entries\n", report->starts(), report->entries_size());
    for (const v1::Imbalance& i : report->imbalances()) {
      fmt::print("{} {} (first: {})\n", i.count(), i.kind(), i.first());
    }
    fmt::print("{}\n", report->balances() ? "balances" : "does not balance");
  }
  if (report->balances()) return OkStatus();
  return DataLoss("session {} does not balance", id);
}

Status ShowJournal(const Common& common, const std::string& id) {
  MESORIG_ASSIGN_OR_RETURN(const Client daemon, FramesClient::Connect(common.daemon()));
  MESORIG_ASSIGN_OR_RETURN(const auto journal, daemon->ReadJournal(id));
  if (common.json) fmt::print("{}\n", JsonText(journal));
  for (const v1::JournalEntry& entry : journal.entries()) {
    if (!common.json) fmt::print("{}\n", EntryText(entry));
  }
  return OkStatus();
}

Status Remove(const Common& common, const std::string& id, bool yes) {
  MESORIG_ASSIGN_OR_RETURN(const Client daemon, FramesClient::Connect(common.daemon()));
  auto reply = daemon->Remove(id, yes);
  if (!yes && absl::IsFailedPrecondition(reply.status())) {
    return Annotate(reply.status(), "--yes removes complete sessions too");
  }
  MESORIG_RETURN_IF_ERROR(reply.status());
  fmt::print("{}\n", common.json
                         ? JsonText(*reply)
                         : fmt::format("{}: removed, {}", id, BytesText(reply->bytes_freed())));
  return OkStatus();
}

struct CleanOptions {
  int keep = -1;
  double older_than_days = -1;
  bool incomplete = false;
};

Status Clean(const Common& common, const CleanOptions& options) {
  std::optional<uint32_t> keep;
  std::optional<double> older_than_s;
  if (options.keep >= 0) keep = static_cast<uint32_t>(options.keep);
  if (options.older_than_days >= 0) older_than_s = options.older_than_days * 24 * 3600;
  if (!keep && !older_than_s) return InvalidArgument("clean: say --keep N or --older-than DAYS");
  MESORIG_ASSIGN_OR_RETURN(const Client daemon, FramesClient::Connect(common.daemon()));
  MESORIG_ASSIGN_OR_RETURN(const auto reply, daemon->Clean(keep, older_than_s, options.incomplete));
  if (common.json) {
    fmt::print("{}\n", JsonText(reply));
    return OkStatus();
  }
  for (const std::string& id : reply.session_ids()) fmt::print("{}: removed\n", id);
  fmt::print("{} sessions removed, {}\n", reply.session_ids_size(), BytesText(reply.bytes_freed()));
  return OkStatus();
}

Status Export(const Common& common, const std::string& id, const std::string& out) {
  MESORIG_ASSIGN_OR_RETURN(const Client daemon, FramesClient::Connect(common.daemon()));
  MESORIG_ASSIGN_OR_RETURN(const auto session, daemon->GetSession(id));
  if (!session.ended()) return FailedPrecondition("session {} is being written", id);
  MESORIG_ASSIGN_OR_RETURN(const Rig rig, ParseRig(session.rig_toml(), "rig.toml"));
  MESORIG_ASSIGN_OR_RETURN(const auto sessions, daemon->ListSessions());
  uint32_t frames = 0, done = 0;
  for (const v1::SessionInfo& info : sessions.sessions()) {
    if (info.session_id() == id) frames = info.frames_durable();
  }
  MESORIG_ASSIGN_OR_RETURN(SessionExport target, SessionExport::Begin(out));
  uint64_t bytes = 0;
  {
    ProgressBar bar;
    for (size_t i = 0; i < rig.cameras.size(); ++i) {
      MESORIG_RETURN_IF_ERROR(
          daemon->ReadFrames(id, static_cast<uint32_t>(i), [&](const v1::Frame& frame) -> Status {
            bytes += frame.pixels().size();
            bar.Show(++done, frames, "frames");
            return target.Add(frame, rig.cameras[i].name);
          }));
    }
  }
  MESORIG_RETURN_IF_ERROR(target.Commit());
  if (common.json) {
    fmt::print("{{\"frames\":{},\"bytes\":{}}}\n", done, bytes);
  } else {
    fmt::print("{}: {} frames, {}\n", out, done, BytesText(bytes));
  }
  return OkStatus();
}

Status SavePreview(const Common& common, uint32_t camera, const std::string& out) {
  MESORIG_ASSIGN_OR_RETURN(const Client daemon, FramesClient::Connect(common.daemon()));
  MESORIG_ASSIGN_OR_RETURN(const v1::PreviewFrame frame, daemon->NextPreview(camera));
  const std::string pgm =
      fmt::format("P5\n{} {}\n255\n{}", frame.width(), frame.height(), frame.grey());
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(out, pgm));
  fmt::print("{}: camera {}, shot {} of {}, {} x {}\n", out, camera, frame.shot(),
             frame.session_id(), frame.width(), frame.height());
  return OkStatus();
}

// A subcommand of `session` with its id.
CLI::App* Naming(CLI::App& group, const char* name, const char* help,
                 const std::shared_ptr<std::string>& id) {
  CLI::App* command = group.add_subcommand(name, help);
  command->add_option("session", *id, "Its id, as `mesorig sessions` tells it")->required();
  return command;
}

}  // namespace

std::vector<Command> AddSessionCommands(CLI::App& app, Common& common) {
  std::vector<Command> commands;
  commands.push_back({app.add_subcommand("sessions", "The daemon's sessions, oldest first"),
                      [&common] { return ShowSessions(common); }});
  CLI::App* group = app.add_subcommand("session", "Look into one session, or tidy up");
  group->require_subcommand(1);
  group->fallthrough();
  const auto id = std::make_shared<std::string>(), out = std::make_shared<std::string>();
  commands.push_back({Naming(*group, "verify", "Read every frame again and balance the ledger", id),
                      [id, &common] { return Verify(common, *id); }});
  commands.push_back({Naming(*group, "journal", "What happened, in order of time", id),
                      [id, &common] { return ShowJournal(common, *id); }});
  const auto yes = std::make_shared<bool>(false);
  CLI::App* remove = Naming(*group, "remove", "Remove a session for good", id);
  remove->add_flag("--yes", *yes, "Even a complete one");
  commands.push_back({remove, [id, yes, &common] { return Remove(common, *id, *yes); }});
  const auto rule = std::make_shared<CleanOptions>();
  CLI::App* clean = group->add_subcommand("clean", "Remove old complete sessions");
  clean->add_option("--keep", rule->keep, "The newest so many stay")->check(CLI::NonNegativeNumber);
  clean->add_option("--older-than", rule->older_than_days, "Days since they were last written")
      ->check(CLI::NonNegativeNumber);
  clean->add_flag("--incomplete", rule->incomplete, "Incomplete and killed ones too");
  commands.push_back({clean, [rule, &common] { return Clean(common, *rule); }});
  CLI::App* save =
      Naming(*group, "export", "Raw frames as PGM files, and the ledger as a table", id);
  save->add_option("--out", *out, "A folder that is not there yet")->required();
  commands.push_back({save, [id, out, &common] { return Export(common, *id, *out); }});
  const auto camera = std::make_shared<uint32_t>(0);
  CLI::App* preview = app.add_subcommand("preview", "The next frame of a camera, small, as a PGM");
  preview->add_option("camera", *camera, "Index in the rig, from 0")->required();
  preview->add_option("--out", *out, "The file")->required();
  commands.push_back(
      {preview, [camera, out, &common] { return SavePreview(common, *camera, *out); }});
  return commands;
}

}  // namespace mesorig::client
