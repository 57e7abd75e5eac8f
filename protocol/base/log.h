#pragma once
// Logging of long-running programs: one line an event, to stderr. Tools print their results
// themselves and log nothing.
//
//   Log("safety").warn("{}: {}", device, why);
//
// A message is of a part of the program (a compile error when it is none of kLogParts), and each
// part has a level of its own, which may change while the program runs.

#include <spdlog/spdlog.h>

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig {

// "program": of its main, and of everything that names no part.
inline constexpr std::array<std::string_view, 14> kLogParts = {
    "program", "access",  "audit",      "bus",    "control", "drivers",  "lease",
    "link",    "metrics", "processing", "safety", "service", "session", "notify"};

// Index into kLogParts.
struct LogPart {
  consteval LogPart(const char* name) {  // NOLINT: a name is a part
    while (index < kLogParts.size() && kLogParts[index] != name) ++index;
    if (index == kLogParts.size()) throw "no such part in kLogParts";
  }
  size_t index = 0;
};

enum class LogFormat {
  kText,  // 2026-01-02T03:04:05.678Z mesorigd safety warning text
  kJson,  // {"time":…,"program":…,"part":…,"level":…,"message":…}
};

struct LogOptions {
  // One for all, and for parts: "info", "safety=debug", "warn,safety=debug,control=trace". Levels:
  // trace, debug, info, warn, error, critical, off.
  std::string levels = "info";
  LogFormat format = LogFormat::kText;
};

// Text, with the levels that the environment variable MESORIG_LOG says (info without it, and for one
// that says nothing sensible). Where stderr is the journal of systemd, lines carry their priority.
void StartLogging(std::string_view program);
// From now on; of one thread. InvalidArgument, and nothing changes, for an unknown part or level.
Status SetLogging(const LogOptions& options);
// Says no as SetLogging would.
Status CheckLogging(const LogOptions& options);

// Thread-safe, for the life of the program. A message of several lines becomes one: control
// characters are escaped.
spdlog::logger& Log(LogPart part);

// The last lines (at most 2,000) as they were written, whatever was asked for on stderr later.
std::vector<std::string> RecentLog();

}  // namespace mesorig
