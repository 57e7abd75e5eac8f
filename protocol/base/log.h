#pragma once
// Logging of long-running programs: one line an event, to stderr. Tools print their results
// themselves and log nothing.

#include <spdlog/spdlog.h>

#include <string_view>

namespace mesorig {

// Lines read `2026-01-02T03:04:05.678 mesorigd info text`. Level from MESORIG_LOG (trace, debug,
// info, warn, error), info without it.
void StartLogging(std::string_view program);

}  // namespace mesorig
