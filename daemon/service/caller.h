#pragma once
// Who calls. Access (docs/access.md) establishes it before any method of ours runs; whatever grants,
// records or refuses asks here.

#include <string>
#include <string_view>

namespace grpc {
class ServerContextBase;
}

namespace mesorig::daemon {

// Each may do what the ones before it may. Processing is mesorig-processd: it reads, and says which
// raw frames may go.
enum class Role { kNone, kObserver, kProcessing, kOperator, kAdministrator };
inline constexpr int kRoles = 5;

struct Caller {
  Role role = Role::kNone;
  std::string name;  // of the person or program: "anna", "uid 1000"; never empty for a call let in
  std::string peer;  // where from: "unix", "ipv4:10.0.0.7:51234"
  std::string via;   // the gateway that forwarded it; empty: none
};

std::string_view Name(Role role);         // "none", "observer", ...
Role RoleNamed(std::string_view name);    // kNone for what names no role

// Of a call that was let in; Role::kNone of any other. Any thread, during the call.
Caller CallerOf(const grpc::ServerContextBase& context);

}  // namespace mesorig::daemon
