#pragma once
// A session from its start to its end: runs its plan, pauses and goes on, recovers from devices
// that fail, and parks when it is aborted (docs/running.md). On the sequencer's thread.

#include <memory>

#include "daemon/control/plan_run.h"
#include "daemon/control/run_context.h"

namespace mesorig::daemon {

// Borrows the context; listens to the session's storage while it lives.
class SessionRun {
 public:
  // Tries to bring failed devices back, and for how long each waits before.
  static constexpr double kRecoveryWaits_s[] = {0.5, 2, 8};

  SessionRun(const RunContext& context, const SessionJob& job);
  ~SessionRun();

  // Everything is off when this returns. OK: nothing is missing. Cancelled: stop or abort, by
  // command; else why it cannot go on: the chain's opening, the device that did not come back.
  Status Run();
  double preparation_s() const { return run_.preparation_s(); }

 private:
  // Shared with the session's listener, of which a call may be under way when this goes. Guarded by
  // the clock's lock.
  struct Storage {
    bool ok = true;
  };
  // Why a run that was cut short ended; OK: nothing but its own result says.
  Status Explain(const RunResult& result) const;
  bool ByHand() const;
  Status EndByHand(const Status& why);
  // Blocks while paused. Errors as Run: it ended here.
  Status Pause(bool for_storage, const std::string& reason);
  Status Continue(bool for_storage);
  // Blocks for a while; the failure itself when there were enough tries.
  Status AwaitDevice(const Status& failure);
  void Journal(JournalKind kind, std::string text);

  const RunContext& context_;
  const SessionJob& job_;
  PlanRun run_;
  const std::shared_ptr<Storage> storage_;
  size_t tries_ = 0;
  uint32_t shots_at_failure_ = 0;
};

}  // namespace mesorig::daemon
