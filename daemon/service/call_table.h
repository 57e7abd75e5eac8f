#pragma once
// What each call of the daemon takes: the one table that the access check, the lease, the audit log,
// the tests and docs/access.md are made from. A call that is not in it is refused.

#include <span>
#include <string_view>

#include "daemon/service/caller.h"

namespace mesorig::daemon {

enum class Lease {
  kNone,  // whatever the lease: reading, and everything that makes the rig safer
  kFree,  // nobody else has it: the request's lease_token is the caller's, or 0 when nobody has one
  kHeld,  // the request's lease_token is that of the lease in force, and the lease is the caller's
};

struct CallRule {
  std::string_view method;  // "Control/Run", without our package; others "/package.Service/Method"
  Role least;               // who may
  Lease lease;
  bool audited;             // what changes something, or lets somebody in
};

std::span<const CallRule> CallTable();
// Null: no such call. `path` as gRPC tells it: "/mesorig.v1.Control/Run".
const CallRule* FindRule(std::string_view path);

}  // namespace mesorig::daemon
