#pragma once
// Sweeps whose raw frames were released: a mark (`sweeps/<sweep>.released`, whole or absent), then
// the sweep's segments are removed. A mark with segments beside it is what a kill in between
// leaves: the sweep is released all the same, and the segments are removed later.

#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/session/session_folder.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// Durable when it returns.
Status MarkReleased(const SessionFolder& folder, std::string_view session_id, uint32_t sweep);

// Whether the sweep has a mark. One that is not byte for byte as MarkReleased writes it counts for
// nothing: the frames are then read, or lost.
bool IsMarkedReleased(const SessionFolder& folder, std::string_view session_id, uint32_t sweep);
// The sweeps that have one.
std::set<uint32_t> FindReleased(const SessionFolder& folder, std::string_view session_id);

// Removes the sweep's segments of these cameras; returns the bytes of those that were there.
// Unavailable names a file that stays; a later call goes on.
StatusOr<uint64_t> RemoveSweepSegments(const SessionFolder& folder,
                                       const std::vector<std::string>& cameras, uint32_t sweep);

}  // namespace mesorig::daemon
