#pragma once
// The stop channel of the daemon's own machine: a socket beside those of gRPC. A client sends one
// line, "stop" or "stop REASON", and gets one back: "ok" when everything is off, or
// "error WHY". Nothing else can be said there.

#include <chrono>
#include <filesystem>
#include <string>
#include <string_view>

#include "protocol/base/status.h"

namespace mesorig::wire {

inline constexpr size_t kMaxStopLine = 512;  // bytes, its '\n' included

// Of the daemon that serves in this runtime directory.
std::filesystem::path StopSocket(const std::filesystem::path& runtime_dir);

// `reason` may be anything: control characters become spaces, what is too long is cut.
std::string StopLine(std::string_view reason);
// The reason (empty: none was given). `line` is without its '\n'. InvalidArgument: anything else.
StatusOr<std::string> ReadStopLine(std::string_view line);

// Says stop and waits for the answer. NotFound: no daemon has such a socket there. Unavailable: the
// daemon does not take or answer it in time. Internal: its answer, when not everything is off.
Status SayStop(const std::filesystem::path& socket, std::string_view reason,
               std::chrono::milliseconds patience = std::chrono::seconds(15));

}  // namespace mesorig::wire
