#pragma once
// Somebody said stop. Every wait that a device or the sequencer makes on behalf of a plan includes
// this flag, so that a stop takes effect within one wait of the rig clock: the wait ends with
// Cancelled and the reason. What brings the rig to rest (quick stop, torque off, lamps off) does
// not look at it.

#include <functional>
#include <string>
#include <string_view>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// Thread-safe: its state is guarded by the clock's lock. The clock outlives it.
class StopFlag {
 public:
  explicit StopFlag(RigClock& clock) : clock_(clock) {}
  StopFlag(const StopFlag&) = delete;
  StopFlag& operator=(const StopFlag&) = delete;

  // Of several raises the first one's reason stays.
  void Raise(std::string_view reason);
  void RaiseInsideChange(std::string_view reason);
  void LowerInsideChange();
  bool RaisedInsideChange() const { return raised_; }
  // Cancelled with the reason while raised.
  Status Check() const;

  // Blocks the calling rig thread until ready() (OK), the flag is up (Cancelled), or the deadline
  // has come (DeadlineExceeded, whose message the caller replaces). `ready` as in RigClock.
  Status Wait(RigTime deadline, const std::function<bool()>& ready) const;

 private:
  RigClock& clock_;
  bool raised_ = false;
  std::string reason_;
};

}  // namespace mesorig::daemon
