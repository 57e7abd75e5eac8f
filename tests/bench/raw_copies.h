#pragma once
// What the machine does with the same bytes without us: MB/s.

#include <filesystem>
#include <vector>

#include "tests/bench/pattern_source.h"

namespace mesorig::bench {

// A file a camera, frame after frame as the source shoots them; after each group of frames an
// fdatasync of every file that it touched. `groups`: frames of each.
double RawWrite(const PatternSource& source, const std::vector<uint32_t>& groups,
                const std::filesystem::path& dir);
// Unix sockets to another process, one a camera, each from a thread.
double RawSockets(const PatternSource& source, double bytes);

}  // namespace mesorig::bench
