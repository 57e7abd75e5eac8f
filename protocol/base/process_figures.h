#pragma once
// What this process takes of the machine, as the kernel counts it.

#include <cstdint>

namespace mesorig {

struct ProcessFigures {
  double cpu_s = 0;  // user and system time, all threads
  uint64_t resident_bytes = 0;
  uint32_t threads = 0, open_files = 0;
  double started_s = 0;  // since the epoch
};

// Zeros for what the kernel does not tell. Any thread.
ProcessFigures ReadProcessFigures();

}  // namespace mesorig
