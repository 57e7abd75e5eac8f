#pragma once
// The sessions of a folder as somebody sees them who has to keep the disk tidy.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/session/session.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

enum class SessionState {
  kLive,  // somebody writes it
  kComplete,
  kIncomplete,  // it was ended so
  kKilled,      // its end is open and nobody writes it
  kDamaged,     // its journal cannot be read; `reason` tells why
};
std::string_view NameOf(SessionState state);

struct SessionInfo {
  std::string id, plan_name, sample_name, reason;
  SessionState state{};
  uint32_t frames_planned = 0, frames_durable = 0;
  uint64_t bytes = 0;  // of its files
  double age_s = 0;    // since its journal was last written
};

// NotFound for an unknown id. Reads the journal's session record and counts its rows.
StatusOr<SessionInfo> DescribeSession(const std::filesystem::path& root, const std::string& id);

// Removes the session; returns the bytes freed. NotFound; FailedPrecondition while it is written;
// Unavailable. After a kill in between, RemoveUnfinished removes the rest.
StatusOr<uint64_t> RemoveSession(const std::filesystem::path& root, const std::string& id);

// What cleaning removes: complete sessions, and with `incomplete` also incomplete and killed ones,
// except the newest `keep` of them, and those written less than `older_than_s` ago.
struct CleanRule {
  std::optional<uint32_t> keep;
  std::optional<double> older_than_s;
  bool incomplete = false;
};
// `sessions`: oldest first. Ids, oldest first. A rule that says neither removes nothing.
std::vector<std::string> SessionsToRemove(const std::vector<SessionInfo>& sessions,
                                          const CleanRule& rule);

// What a kill left of sessions that were being created or removed: `.<id>.part`, and nothing else.
// To be called when nobody creates any. Returns how many there were.
StatusOr<uint32_t> RemoveUnfinished(const std::filesystem::path& root);

// Bytes that the disk of this folder (or of the nearest that exists above it) still takes.
StatusOr<uint64_t> FreeBytes(const std::filesystem::path& root);

}  // namespace mesorig::daemon
