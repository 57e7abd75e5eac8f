#pragma once
// One daemon a state folder: sessions, counters and the audit log below it have one writer.

#include <filesystem>

#include "protocol/base/claim.h"

namespace mesorig::daemon {

std::filesystem::path StateClaimFile(const std::filesystem::path& state_dir);
// Creates the folder if need be. FailedPrecondition names the process that has it.
StatusOr<FileClaim> ClaimState(const std::filesystem::path& state_dir);

}  // namespace mesorig::daemon
