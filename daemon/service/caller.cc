#include "daemon/service/caller.h"

#include <grpcpp/server_context.h>

namespace mesorig::daemon {

std::string_view Name(Role role) {
  switch (role) {
    case Role::kNone:
      return "none";
    case Role::kObserver:
      return "observer";
    case Role::kOperator:
      return "operator";
    case Role::kAdministrator:
      return "administrator";
  }
  return "none";
}

// The socket lets in the user of the daemon alone.
Caller CallerOf(const grpc::ServerContextBase& context) {
  return {Role::kAdministrator, "local", context.peer(), ""};
}

}  // namespace mesorig::daemon
