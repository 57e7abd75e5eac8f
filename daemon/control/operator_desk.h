#pragma once
// What the plan asks of the operator's hands, one thing at a time. A console acknowledges; it
// cannot do more (DESIGN, "Safety"): that the door was cycled and reset was pressed, the rig itself
// says (InterlockChain::Visit).

#include <optional>
#include <string>

#include "daemon/device/stop_flag.h"
#include "daemon/safety/interlock_chain.h"
#include "protocol/base/clocks.h"

namespace mesorig::daemon {

struct OperatorPrompt {
  uint32_t id = 0;  // counts a session's prompts from 1
  std::string text, mount;
  bool acknowledged = false, door_cycled = false, reset = false;
};

// Thread-safe. Borrows everything.
class OperatorDesk {
 public:
  OperatorDesk(RigClock& clock, InterlockChain& chain, const StopFlag& stop)
      : clock_(clock), chain_(chain), stop_(stop) {}

  // On the sequencer's thread. `posted` is called once the prompt stands; false takes it back
  // (Cancelled). Blocks until the operator has acknowledged, cycled the door and pressed reset, or
  // somebody said stop (Cancelled).
  Status Ask(std::string text, std::string mount, const std::function<bool()>& posted);
  // FailedPrecondition when nothing is asked, or something else.
  Status Acknowledge(uint32_t id);
  std::optional<OperatorPrompt> current() const;
  // Somebody was asked, and a command ended that before the rig said that the hands are out.
  bool hands_in_the_rig() const;
  void BeginSession();  // ids count from 1 again

 private:
  RigClock& clock_;
  InterlockChain& chain_;
  const StopFlag& stop_;
  // Guarded by the clock's lock:
  uint32_t last_id_ = 0;
  std::optional<OperatorPrompt> prompt_;
  bool hands_ = false;
};

}  // namespace mesorig::daemon
