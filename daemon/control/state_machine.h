#pragma once
// Where the sequencer is, and what was last asked of its run. Commands come from any thread; the
// sequencer's thread takes what they order and says where it has got to. What a command may do in
// which state is in state_table.h alone.

#include <functional>
#include <string>
#include <string_view>

#include "daemon/control/state_table.h"
#include "daemon/device/stop_flag.h"
#include "protocol/base/clocks.h"

namespace mesorig::daemon {

// What the run under way is asked to do; a later one outweighs an earlier one.
enum class RunOrder : uint8_t { kNone, kPause, kPauseNow, kAbort, kStop };

// Thread-safe: its state is guarded by the clock's lock. Borrows both.
class StateMachine {
 public:
  StateMachine(RigClock& clock, StopFlag& stop) : clock_(clock), stop_(stop) {}

  // FailedPrecondition, with the state's name and what is possible in it, for a command that the
  // table does not allow. Otherwise the state that follows stands when this returns, and the
  // StopFlag is up where waits must end at once. `take` runs under the clock's lock before; its
  // error is the refusal.
  Status Give(SequencerCommand command, std::string_view reason,
              const std::function<Status()>& take = {});
  // Says no as Give would, changes nothing.
  Status Check(SequencerCommand command) const;

  // Of the sequencer's thread. Changes `from` to `to`; false, and nothing changes, when a command
  // came first.
  bool Move(SequencerState from, SequencerState to, std::string_view message);
  // Rest: idle or fault, whatever stood before. No order stands any more.
  void Rest(SequencerState state, std::string_view message);
  // A run goes on after a pause, or parks: its waits count again, unless somebody said stop since.
  void LowerStop();

  SequencerState state() const;
  RunOrder order() const;
  std::string message() const;
  SequencerState StateInsideChange() const { return state_; }
  const std::string& MessageInsideChange() const { return message_; }

 private:
  Status CheckInsideChange(SequencerCommand command) const;
  void Apply(SequencerCommand command, std::string_view reason);
  void Order(RunOrder order, SequencerState state, std::string_view reason);

  RigClock& clock_;
  StopFlag& stop_;
  SequencerState state_ = SequencerState::kIdle;
  RunOrder order_ = RunOrder::kNone;
  std::string message_;
};

}  // namespace mesorig::daemon
