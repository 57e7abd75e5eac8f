#include "daemon/service/lease_book.h"

#include <algorithm>

namespace mesorig::daemon {
namespace {

using Kind = LeaseState::Kind;
using Change = LeaseChange::Kind;

double SecondsTo(LeaseTime then, LeaseTime now) {
  return std::max(0.0, std::chrono::duration<double>(then - now).count());
}

}  // namespace

std::string_view Name(LeaseChange::Kind kind) {
  switch (kind) {
    case Change::kAcquired:
      return "acquired";
    case Change::kReleased:
      return "released";
    case Change::kExpired:
      return "expired";
    case Change::kTaken:
      return "taken";
    case Change::kRequested:
      return "requested";
    case Change::kRunBegan:
      return "run began";
    case Change::kRunEnded:
      return "run ended";
  }
  return "?";
}

void LeaseBook::Note(Change kind, const std::string& requester) {
  changes_.push_back({kind, state_.holder, requester, state_.token});
}

void LeaseBook::End(Change how, const std::string& by) {
  Note(how, by);
  state_.kind = Kind::kFree;
  state_.holder.clear();
  state_.requested_by.clear();
}

std::optional<LeaseTime> LeaseBook::Expire(LeaseTime now) {
  if (state_.kind == Kind::kManual && now >= expires_) End(Change::kExpired);
  if (!reserved_for_.empty() && now >= reserved_until_) reserved_for_.clear();
  if (state_.kind == Kind::kManual) return expires_;
  if (!reserved_for_.empty()) return reserved_until_;
  return std::nullopt;
}

LeaseState LeaseBook::State(LeaseTime now) const {
  LeaseState state = state_;
  if (state.kind == Kind::kManual) state.left_s = SecondsTo(expires_, now);
  if (state.kind == Kind::kFree) state.requested_by = reserved_for_;
  return state;
}

std::string LeaseBook::WhoHasIt(LeaseTime now) const {
  switch (state_.kind) {
    case Kind::kManual:
      return fmt::format("{} has control of the rig, for another {:.1f} s unless it is renewed",
                         state_.holder, SecondsTo(expires_, now));
    case Kind::kRun:
      return fmt::format("a plan that {} began has control of the rig", state_.holder);
    case Kind::kFree:
      break;
  }
  if (reserved_for_.empty()) return "nobody has control of the rig";
  return fmt::format("control of the rig was given up for {}, who may take it for another {:.1f} s",
                     reserved_for_, SecondsTo(reserved_until_, now));
}

StatusOr<uint64_t> LeaseBook::Acquire(const Caller& caller, std::chrono::milliseconds span,
                                      bool take, LeaseTime now) {
  Expire(now);
  if (span == span.zero()) span = kDefaultSpan;
  if (span < kShortest || span > kLongest) {
    return InvalidArgument("lease: a span of {} ms is not in [{}, {}] ms", span.count(),
                           kShortest.count(), kLongest.count());
  }
  if (state_.kind == Kind::kRun) {
    return FailedPrecondition("{}; `mesorig stop` and `mesorig pause` need no lease",
                              WhoHasIt(now));
  }
  const bool held = state_.kind == Kind::kManual;
  const std::string& whose = held ? state_.holder : reserved_for_;
  if (!whose.empty() && !take && (held || whose != caller.name)) {
    return FailedPrecondition(
        "{}; {}", WhoHasIt(now),
        whose == caller.name ? "--take ends it there" : "`mesorig lease request` asks for it");
  }
  if (!whose.empty() && whose != caller.name && caller.role != Role::kAdministrator) {
    return absl::PermissionDeniedError(
        fmt::format("{}; only an administrator may take it, and {} is {}", WhoHasIt(now),
                    caller.name, Name(caller.role)));
  }
  if (held) End(Change::kTaken, caller.name);
  reserved_for_.clear();
  state_ = {Kind::kManual, state_.token + 1, caller.name, 0, {}};
  span_ = span;
  expires_ = now + span;
  Note(Change::kAcquired);
  return state_.token;
}

Status LeaseBook::Check(const Caller& caller, uint64_t token, LeaseTime now) {
  Expire(now);
  if (state_.kind == Kind::kManual && state_.token == token && state_.holder == caller.name) {
    return OkStatus();
  }
  if (token == 0) return FailedPrecondition("this needs control of the rig, and {}", WhoHasIt(now));
  return FailedPrecondition("lease {} of {} is over: {}", token, caller.name, WhoHasIt(now));
}

Status LeaseBook::Renew(const Caller& caller, uint64_t token, LeaseTime now) {
  MESORIG_RETURN_IF_ERROR(Check(caller, token, now));
  expires_ = now + span_;
  return OkStatus();
}

Status LeaseBook::Release(const Caller& caller, uint64_t token, LeaseTime now) {
  MESORIG_RETURN_IF_ERROR(Check(caller, token, now));
  const std::string next = state_.requested_by;
  End(Change::kReleased, next);
  reserved_for_ = next;
  reserved_until_ = now + kReserved;
  return OkStatus();
}

Status LeaseBook::Request(const Caller& caller, LeaseTime now) {
  Expire(now);
  if (state_.kind != Kind::kManual) {
    return FailedPrecondition("nobody can be asked: {}", WhoHasIt(now));
  }
  if (state_.holder == caller.name) {
    return FailedPrecondition("{} has control of the rig already", caller.name);
  }
  state_.requested_by = caller.name;  // the last one who asks is the next
  Note(Change::kRequested, caller.name);
  return OkStatus();
}

Status LeaseBook::CheckFree(const Caller& caller, uint64_t token, LeaseTime now) {
  Expire(now);
  if (state_.kind == Kind::kFree && token == 0) {
    if (reserved_for_.empty() || reserved_for_ == caller.name) return OkStatus();
    return FailedPrecondition("{}", WhoHasIt(now));
  }
  if (state_.kind == Kind::kRun) return FailedPrecondition("{}", WhoHasIt(now));
  return Check(caller, token, now);
}

StatusOr<uint64_t> LeaseBook::BeginRun(const Caller& caller, uint64_t token, LeaseTime now) {
  MESORIG_RETURN_IF_ERROR(CheckFree(caller, token, now));
  if (state_.kind == Kind::kManual) End(Change::kReleased);
  reserved_for_.clear();
  state_ = {Kind::kRun, state_.token + 1, caller.name, 0, {}};
  Note(Change::kRunBegan);
  return state_.token;
}

void LeaseBook::EndRun(uint64_t token) {
  if (state_.kind == Kind::kRun && state_.token == token) End(Change::kRunEnded);
}

}  // namespace mesorig::daemon
