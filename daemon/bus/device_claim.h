#pragma once
// One process has a device. A claim is a name in the network namespace (an abstract socket), which
// ends with its process whatever happens to it, and leaves no file.

#include <string>

#include "protocol/base/status.h"
#include "protocol/base/unique_fd.h"

namespace mesorig::daemon {

// Held while the descriptor is open. FailedPrecondition: another process has it; the message has its
// pid and command.
StatusOr<UniqueFd> ClaimDevice(const std::string& device);

}  // namespace mesorig::daemon
