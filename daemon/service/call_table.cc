#include "daemon/service/call_table.h"

#include <algorithm>
#include <array>

namespace mesorig::daemon {
namespace {

constexpr std::string_view kPackage = "/mesorig.v1.";

using enum Role;

// A method of another package stands with its full name.
constexpr std::array kCalls = {
    CallRule{"Control/Hello", kObserver, Lease::kNone, false},
    CallRule{"Control/GetStatus", kObserver, Lease::kNone, false},
    CallRule{"Control/Watch", kObserver, Lease::kNone, false},
    CallRule{"Control/Stop", kObserver, Lease::kNone, true},
    CallRule{"Control/Pause", kOperator, Lease::kNone, true},
    CallRule{"Control/Abort", kOperator, Lease::kNone, true},
    CallRule{"Control/Acknowledge", kOperator, Lease::kNone, true},
    CallRule{"Control/Run", kOperator, Lease::kFree, true},
    CallRule{"Control/Arm", kOperator, Lease::kFree, true},
    CallRule{"Control/ResumeSession", kOperator, Lease::kFree, true},
    CallRule{"Control/Reset", kOperator, Lease::kFree, true},
    // The plan's own lease is in force.
    CallRule{"Control/Start", kOperator, Lease::kNone, true},
    CallRule{"Control/Continue", kOperator, Lease::kNone, true},
    CallRule{"Control/AcquireLease", kOperator, Lease::kNone, true},
    CallRule{"Control/RequestHandover", kOperator, Lease::kNone, true},
    CallRule{"Control/RenewLease", kOperator, Lease::kHeld, false},  // three a lease; its end is recorded
    CallRule{"Control/ReleaseLease", kOperator, Lease::kHeld, true},
    CallRule{"Control/Jog", kOperator, Lease::kHeld, true},
    CallRule{"Control/MoveAxis", kOperator, Lease::kHeld, true},
    CallRule{"Control/HomeAxis", kOperator, Lease::kHeld, true},
    CallRule{"Control/SetLamp", kOperator, Lease::kHeld, true},
    CallRule{"Control/TestLaser", kOperator, Lease::kHeld, true},
    CallRule{"Control/ReadAudit", kOperator, Lease::kNone, false},
    CallRule{"Frames/GetSession", kObserver, Lease::kNone, false},
    CallRule{"Frames/ListSessions", kObserver, Lease::kNone, false},
    CallRule{"Frames/Subscribe", kObserver, Lease::kNone, false},
    CallRule{"Frames/Verify", kObserver, Lease::kNone, false},
    CallRule{"Frames/ReadJournal", kObserver, Lease::kNone, false},
    CallRule{"Frames/Preview", kObserver, Lease::kNone, false},
    CallRule{"Frames/ReleaseSweep", kProcessing, Lease::kNone, true},
    CallRule{"Frames/RemoveSession", kAdministrator, Lease::kNone, true},
    CallRule{"Frames/CleanSessions", kAdministrator, Lease::kNone, true},
    CallRule{"Operations/Diagnose", kOperator, Lease::kNone, true},
    CallRule{"/grpc.health.v1.Health/Check", kObserver, Lease::kNone, false},
    CallRule{"/grpc.health.v1.Health/Watch", kObserver, Lease::kNone, false},
};

}  // namespace

std::span<const CallRule> CallTable() { return kCalls; }

const CallRule* FindRule(std::string_view path) {
  if (path.starts_with(kPackage)) path.remove_prefix(kPackage.size());
  const auto at = std::find_if(kCalls.begin(), kCalls.end(),
                               [&](const CallRule& rule) { return rule.method == path; });
  return at == kCalls.end() ? nullptr : &*at;
}

}  // namespace mesorig::daemon
