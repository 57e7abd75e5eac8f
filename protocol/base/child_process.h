#pragma once
// Runs another program to its end, without a shell: arguments are handed over as they are.

#include <atomic>
#include <chrono>
#include <string>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig {

struct ChildCommand {
  std::vector<std::string> argv;         // argv[0]: a path, or a name that is looked for in PATH
  std::vector<std::string> environment;  // "KEY=value", beside that of this process
  std::string input;                     // its stdin
  std::chrono::milliseconds limit{10'000};  // host time; then it is killed, and what it started too
};

struct ChildOutcome {
  int code = 0;        // exit status; 128 + signal when it was killed
  std::string output;  // the first 4 KiB of stdout and stderr
};

// Blocks. The child gets no descriptor of ours, unblocked signals, and a process group of its own.
// NotFound or InvalidArgument when it cannot be started; DeadlineExceeded when it took longer than
// `limit`; Cancelled when `cancel` became true meanwhile (looked at 20 times a second). Any thread.
StatusOr<ChildOutcome> RunChild(const ChildCommand& command,
                                const std::atomic<bool>* cancel = nullptr);

}  // namespace mesorig
