#pragma once
// Who controls the rig by hand: at most one at a time, for as long as he renews (docs/lease.md).
// Rules only: no thread, no clock, no I/O; LeaseKeeper adds them. Not thread-safe.

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "daemon/service/caller.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

using LeaseTime = std::chrono::steady_clock::time_point;  // host time

// What changed, for events and the audit log.
struct LeaseChange {
  enum class Kind { kAcquired, kReleased, kExpired, kTaken, kRequested, kRunBegan, kRunEnded };
  Kind kind{};
  std::string holder;     // who has it, or had it
  std::string requester;  // kRequested: who asks for it; kTaken: who took it
  uint64_t token = 0;     // of the lease that this is about
};
std::string_view Name(LeaseChange::Kind kind);  // "acquired", ...

struct LeaseState {
  enum class Kind { kFree, kManual, kRun };
  Kind kind = Kind::kFree;
  uint64_t token = 0;        // of the lease in force, or the last one
  std::string holder;        // kManual: his name; kRun: who began the run
  double left_s = 0;         // kManual: until it expires
  std::string requested_by;  // who waits for it; empty: nobody
};

// Tokens only grow: each lease, manual or of a run, has a higher one than all before it.
class LeaseBook {
 public:
  static constexpr std::chrono::milliseconds kDefaultSpan{10'000}, kShortest{1'000},
      kLongest{60'000};
  // After a release on request the one who asked has it to himself for so long.
  static constexpr std::chrono::milliseconds kReserved{10'000};

  // Tokens begin after `last_token`.
  explicit LeaseBook(uint64_t last_token) { state_.token = last_token; }

  // A lease for `caller`. Zero span: the default. FailedPrecondition: somebody else has it, or a
  // plan runs (the message names him and what is possible); InvalidArgument: a span out of range.
  // `take` ends a lease that is held: one's own from elsewhere, and, of an administrator,
  // anybody's; PermissionDenied for others.
  StatusOr<uint64_t> Acquire(const Caller& caller, std::chrono::milliseconds span, bool take,
                             LeaseTime now);
  // FailedPrecondition: not the lease in force.
  Status Renew(const Caller& caller, uint64_t token, LeaseTime now);
  Status Release(const Caller& caller, uint64_t token, LeaseTime now);
  // Asks the holder to give it up. FailedPrecondition: it is free, his own, or a plan's.
  Status Request(const Caller& caller, LeaseTime now);

  // OK: a manual command with this token may go on to the rig.
  Status Check(const Caller& caller, uint64_t token, LeaseTime now);
  // OK: `caller` may begin a plan: nobody else has the lease. With the token of his own, or with 0
  // when it is free.
  Status CheckFree(const Caller& caller, uint64_t token, LeaseTime now);

  // The daemon takes the lease for a plan that `caller` began; the manual lease ends. Errors as
  // CheckFree.
  StatusOr<uint64_t> BeginRun(const Caller& caller, uint64_t token, LeaseTime now);
  // Nothing, when this run's lease is not in force any more.
  void EndRun(uint64_t token);

  // Ends what has expired. When something may expire next; none: nothing will.
  std::optional<LeaseTime> Expire(LeaseTime now);
  LeaseState State(LeaseTime now) const;
  // What changed since the last call, in order.
  std::vector<LeaseChange> TakeChanges() { return std::exchange(changes_, {}); }

 private:
  void End(LeaseChange::Kind how, const std::string& by = {});
  void Note(LeaseChange::Kind kind, const std::string& requester = {});
  std::string WhoHasIt(LeaseTime now) const;

  LeaseState state_;  // but for left_s
  std::chrono::milliseconds span_{};
  LeaseTime expires_{};
  std::string reserved_for_;  // while free; empty: nobody
  LeaseTime reserved_until_{};
  std::vector<LeaseChange> changes_;
};

}  // namespace mesorig::daemon
