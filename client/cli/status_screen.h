#pragma once
// What the daemon does, on one screen of 80 x 24.

#include <string>
#include <vector>

#include "protocol/messages/control.pb.h"

namespace mesorig::client {

inline constexpr size_t kScreenColumns = 80, kScreenLines = 24;

// `events`: the latest ones, oldest first; as many of the last as there is room for are shown. No line is longer than kScreenColumns, and there are at
// most kScreenLines: what does not fit is counted.
std::string StatusScreen(const v1::HelloReply& hello, const v1::StatusReply& status,
                         const std::vector<v1::Event>& events);

}  // namespace mesorig::client
