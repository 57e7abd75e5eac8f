#pragma once
// Virtual time inside one process: when every member waits and an activity is on, time jumps to the
// earliest deadline.

#include <algorithm>

#include "protocol/base/clocks.h"

namespace mesorig::daemon {

class FakeRigClock final : public RigClock {
 protected:
  RigTime NowLocked() const override { return now_; }
  void OnChangeLocked(std::unique_lock<std::mutex>&) override {
    if (!QuiescentLocked()) return;
    const RigTime next = EarliestDeadlineLocked();
    if (next == kNever) return;
    now_ = std::max(now_, next);
    WakeReadyLocked();
  }
  void BlockLocked(std::unique_lock<std::mutex>& lock, Entry& entry) override {
    while (entry.waiting) entry.wake.wait(lock);
  }

 private:
  RigTime now_{};
};

}  // namespace mesorig::daemon
