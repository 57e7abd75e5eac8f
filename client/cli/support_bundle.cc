#include "client/cli/support_bundle.h"

#include <stdlib.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>

#include "client/cli/commands.h"
#include "client/cli/text.h"
#include "client/connection/daemon_client.h"
#include "client/connection/frames_client.h"
#include "protocol/base/child_process.h"
#include "protocol/base/file_writer.h"
#include "protocol/base/program.h"

namespace mesorig::client {
namespace {

namespace fs = std::filesystem;

constexpr int kSessionsTold = 20, kEntriesTold = 200;  // the latest

// Removed at the end.
struct Folder {
  fs::path path;
  ~Folder() {
    std::error_code ignored;
    if (!path.empty()) fs::remove_all(path, ignored);
  }
};

bool IsName(const std::string& name) {
  return !name.empty() && name[0] != '.' && name[0] != '-' &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return std::isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '_';
         });
}

std::string JournalText(const v1::JournalReply& journal) {
  std::string text;
  const int from = std::max(0, journal.entries_size() - kEntriesTold);
  if (from > 0) text = fmt::format("({} earlier entries)\n", from);
  for (int i = from; i < journal.entries_size(); ++i) {
    const v1::JournalEntry& entry = journal.entries(i);
    text += fmt::format("{:12.3f} s  {:<10} {:>3} {:>12.6g}  {}\n", entry.rig_s(), entry.kind(),
                        entry.index(), entry.value(), entry.text());
  }
  return text;
}

// What cannot be had stands in the bundle as such.
void AddSessions(const Common& common, std::vector<BundleFile>& files) {
  const auto frames = FramesClient::Connect(common.daemon());
  const auto list = frames.ok() ? (*frames)->ListSessions() : frames.status();
  if (!list.ok()) {
    files.push_back({"sessions.txt", fmt::format("not told: {}\n", Message(list.status()))});
    return;
  }
  files.push_back({"sessions.json", JsonText(*list) + '\n'});
  const int from = std::max(0, list->sessions_size() - kSessionsTold);
  for (int i = from; i < list->sessions_size(); ++i) {
    const std::string& id = list->sessions(i).session_id();
    const auto journal = (*frames)->ReadJournal(id);
    files.push_back({fmt::format("journal-{}.txt", id),
                     journal.ok() ? JournalText(*journal)
                                  : fmt::format("not told: {}\n", Message(journal.status()))});
  }
}

Status MakeBundle(const Common& common, const std::string& out) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
  std::vector<BundleFile> files;
  files.push_back({"client.txt", fmt::format("mesorig {}\n", kVersion)});
  files.push_back({"hello.json", JsonText(daemon->hello()) + '\n'});
  MESORIG_ASSIGN_OR_RETURN(const v1::StatusReply status, daemon->GetStatus());
  files.push_back({"status.json", JsonText(status) + '\n'});
  std::string events;
  for (const v1::Event& event : daemon->LastEvents(status, 500)) {
    events += fmt::format("{:>8} {}\n", event.sequence(), EventText(event));
  }
  files.push_back({"events.txt", std::move(events)});
  AddSessions(common, files);
  MESORIG_ASSIGN_OR_RETURN(const v1::DiagnoseReply diagnosis, daemon->Diagnose());
  for (const v1::DiagnosticText& text : diagnosis.texts()) {
    files.push_back({"daemon-" + text.name(), text.content()});
  }
  MESORIG_RETURN_IF_ERROR(WriteBundle(out, files));
  fmt::print("{}: {} files, {}\n", out, files.size(), BytesText(fs::file_size(out)));
  return OkStatus();
}

}  // namespace

Status WriteBundle(const fs::path& out, const std::vector<BundleFile>& files) {
  const std::string name = out.filename().string();
  constexpr std::string_view kEnding = ".tar.gz";
  if (!name.ends_with(kEnding) || name.size() == kEnding.size()) {
    return InvalidArgument("{}: the name of a bundle ends in {}", out.string(), kEnding);
  }
  std::error_code error;
  if (fs::exists(out, error)) return InvalidArgument("{}: is there already", out.string());
  const std::string inner = name.substr(0, name.size() - kEnding.size());
  if (!IsName(inner)) return InvalidArgument("{}: letters, digits, . - _ only", out.string());
  std::string pattern = (fs::temp_directory_path(error) / "mesorig-bundle-XXXXXX").string();
  if (::mkdtemp(pattern.data()) == nullptr) {
    return Unavailable("{}: {}", pattern, std::strerror(errno));
  }
  const Folder folder{pattern};
  fs::create_directory(folder.path / inner, error);
  for (const BundleFile& file : files) {
    if (!IsName(file.name)) return InvalidArgument("bundle: \"{}\" is no file name", file.name);
    MESORIG_RETURN_IF_ERROR(WriteFileAtomically(folder.path / inner / file.name, file.content));
  }
  MESORIG_ASSIGN_OR_RETURN(AtomicFile whole, AtomicFile::Create(out));
  ChildCommand tar;
  tar.argv = {"tar",  "--create", "--gzip", "--owner=0", "--group=0", "--file",
              whole.temporary_path().string(), "--directory", folder.path.string(), inner};
  tar.limit = std::chrono::minutes(1);
  MESORIG_ASSIGN_OR_RETURN(const ChildOutcome made, RunChild(tar));
  if (made.code != 0) return Unavailable("tar ended with {}: {}", made.code, made.output);
  return whole.Commit();
}

Command AddSupportBundleCommand(CLI::App& app, Common& common) {
  auto out = std::make_shared<std::string>();
  CLI::App* bundle = app.add_subcommand(
      "support-bundle",
      "Versions, status, events, journals, log, settings and metrics in one file for somebody who "
      "helps; no pixels, no keys, no secrets");
  bundle->add_option("out", *out, "OUT.tar.gz")->required();
  return {bundle, [out, &common] { return MakeBundle(common, *out); }};
}

}  // namespace mesorig::client
