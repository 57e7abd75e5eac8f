#include "daemon/session/housekeeping.h"

#include <sys/statvfs.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>

#include "daemon/session/ledger.h"
#include "daemon/session/session_folder.h"

namespace mesorig::daemon {
namespace {

uint64_t BytesBelow(const std::filesystem::path& dir) {
  uint64_t bytes = 0;
  std::error_code error;
  for (std::filesystem::recursive_directory_iterator at(dir, error), end; !error && at != end;
       at.increment(error)) {
    std::error_code ignored;
    if (at->is_regular_file(ignored)) bytes += at->file_size(ignored);
  }
  return bytes;
}

SessionState StateOf(SessionEnd end, bool is_locked) {
  if (end == SessionEnd::kComplete) return SessionState::kComplete;
  if (is_locked) return SessionState::kLive;
  return end == SessionEnd::kIncomplete ? SessionState::kIncomplete : SessionState::kKilled;
}

}  // namespace

std::string_view NameOf(SessionState state) {
  switch (state) {
    case SessionState::kLive:
      return "live";
    case SessionState::kComplete:
      return "complete";
    case SessionState::kIncomplete:
      return "incomplete";
    case SessionState::kKilled:
      return "killed";
    case SessionState::kDamaged:
      return "damaged";
  }
  return "unknown";
}

StatusOr<SessionInfo> DescribeSession(const std::filesystem::path& root, const std::string& id) {
  const SessionFolder folder(root / id);
  std::error_code error;
  if (!IsFileName(id) || !std::filesystem::exists(folder.journal(), error)) {
    return NotFound("no session \"{}\" in {}", id, root.string());
  }
  SessionInfo info;
  info.id = id;
  info.bytes = BytesBelow(folder.dir());
  auto written = std::filesystem::last_write_time(folder.journal(), error);
  std::filesystem::path wal = folder.journal();
  wal += "-wal";
  std::error_code no_wal;
  const auto wal_written = std::filesystem::last_write_time(wal, no_wal);
  if (!no_wal) written = std::max(written, wal_written);
  const std::chrono::duration<double> age = std::filesystem::file_time_type::clock::now() - written;
  info.age_s = error ? 0 : std::max(0.0, age.count());
  const auto ledger = Ledger::Open(folder.journal());
  const auto summary = ledger.ok() ? (*ledger)->ReadSummary() : ledger.status();
  if (!summary.ok()) {
    info.state = SessionState::kDamaged;
    info.reason = std::string(Message(summary.status()));
    return info;
  }
  info.plan_name = summary->plan_name;
  info.sample_name = summary->sample_name;
  info.reason = summary->reason;
  info.frames_planned = summary->frames_planned;
  info.frames_durable = summary->frames_durable;
  info.state = StateOf(summary->end, IsLocked(folder));
  return info;
}

StatusOr<uint64_t> RemoveSession(const std::filesystem::path& root, const std::string& id) {
  const SessionFolder folder(root / id);
  std::error_code error;
  if (!IsFileName(id) || !std::filesystem::exists(folder.journal(), error)) {
    return NotFound("no session \"{}\" in {}", id, root.string());
  }
  // Held until it is gone: nobody resumes it meanwhile. (One without a plan.bin nobody can.)
  UniqueFd lock;
  if (std::filesystem::exists(folder.plan(), error)) {
    MESORIG_ASSIGN_OR_RETURN(lock, LockSession(folder));
  }
  const uint64_t bytes = BytesBelow(folder.dir());
  const std::filesystem::path part = root / fmt::format(".{}.part", id);
  std::filesystem::remove_all(part, error);
  std::filesystem::rename(folder.dir(), part, error);
  if (!error) std::filesystem::remove_all(part, error);
  if (error)
    return Unavailable("{}: cannot be removed: {}", folder.dir().string(), error.message());
  return bytes;
}

std::vector<std::string> SessionsToRemove(const std::vector<SessionInfo>& sessions,
                                          const CleanRule& rule) {
  std::vector<std::string> ids;
  if (!rule.keep && !rule.older_than_s) return ids;
  uint32_t kept = 0;
  for (auto at = sessions.rbegin(); at != sessions.rend(); ++at) {
    const bool unfinished =
        at->state == SessionState::kIncomplete || at->state == SessionState::kKilled;
    if (at->state != SessionState::kComplete && !(rule.incomplete && unfinished)) continue;
    if (rule.keep && kept < *rule.keep) {
      ++kept;
    } else if (!rule.older_than_s || at->age_s >= *rule.older_than_s) {
      ids.push_back(at->id);
    }
  }
  std::reverse(ids.begin(), ids.end());
  return ids;
}

StatusOr<uint32_t> RemoveUnfinished(const std::filesystem::path& root) {
  std::vector<std::filesystem::path> parts;
  std::error_code error;
  for (std::filesystem::directory_iterator at(root, error), end; !error && at != end;
       at.increment(error)) {
    const std::string name = at->path().filename().string();
    if (name.size() > 6 && name.front() == '.' && name.ends_with(".part") &&
        IsFileName(std::string_view(name).substr(1, name.size() - 6)) && at->is_directory(error) &&
        !at->is_symlink(error)) {
      parts.push_back(at->path());
    }
  }
  for (const auto& part : parts) {
    std::filesystem::remove_all(part, error);
    if (error) return Unavailable("{}: cannot be removed: {}", part.string(), error.message());
  }
  return static_cast<uint32_t>(parts.size());
}

StatusOr<uint64_t> FreeBytes(const std::filesystem::path& root) {
  std::error_code error;
  std::filesystem::path at = std::filesystem::absolute(root, error);
  while (!std::filesystem::exists(at, error) && at.has_relative_path()) at = at.parent_path();
  struct statvfs info {};
  if (::statvfs(at.c_str(), &info) != 0) {
    return Unavailable("{}: statvfs: {}", at.string(), strerror(errno));
  }
  return static_cast<uint64_t>(info.f_bavail) * info.f_frsize;
}

}  // namespace mesorig::daemon
