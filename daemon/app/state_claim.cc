#include "daemon/app/state_claim.h"

namespace mesorig::daemon {

std::filesystem::path StateClaimFile(const std::filesystem::path& state_dir) {
  return state_dir / ".mesorigd.lock";
}

StatusOr<FileClaim> ClaimState(const std::filesystem::path& state_dir) {
  std::error_code error;
  std::filesystem::create_directories(state_dir, error);
  if (error) return InvalidArgument("state directory {}: {}", state_dir.string(), error.message());
  return FileClaim::Take(StateClaimFile(state_dir),
                         fmt::format("state directory {} is in use by another mesorigd",
                                     state_dir.string()));
}

}  // namespace mesorig::daemon
