#pragma once
// What happens to the messages of one device on their way, by the words of the back-channel:
//
//   drop [N] [in|out]       the next N messages are lost
//   delay MS [N] [in|out]   the next N messages come MS milliseconds late, others overtake them
//   corrupt [N] [in|out]    one byte of each of the next N messages is damaged
//   duplicate [N] [in|out]  the next N messages come twice
//   disconnect              nothing goes in or out any more, what was on its way is lost
//   replug [MS]             back again, MS milliseconds from now
//
// in: to the device; out: from it (the default). N is 1 unless told. One fault a message: of
// several that wait the order above decides. Which byte is damaged follows from how many were
// before: equal injections give equal damage. Called by the dispatcher only.

#include <array>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::simulator {

class MessageFaults {
 public:
  enum class Way { kIn, kOut };
  // Nothing: none of these words. InvalidArgument: a number that is not in its range.
  std::optional<Status> Inject(RigTime now, std::string_view text);
  // What is left of a message: none, one or two. What is late comes by RunEvent.
  std::vector<std::string> Pass(Way way, RigTime now, std::string message);
  bool plugged() const { return plugged_; }
  // Told after each change of the plug.
  void OnPlug(std::function<void(bool plugged, RigTime now)> f) { on_plug_ = std::move(f); }

  // When a late message arrives or the plug goes in again.
  RigTime NextEvent() const;
  struct Late {
    Way way{};
    RigTime due{};
    std::string message;
  };
  // Puts the plug in when that is due; returns what arrives now, in order.
  std::vector<Late> RunEvent(RigTime now);

 private:
  struct Counts {
    uint32_t drop = 0, delay = 0, corrupt = 0, duplicate = 0;
    RigTime by{};  // of the delayed ones
  };
  void SetPlugged(bool plugged, RigTime now);
  Counts& of(Way way) { return counts_[way == Way::kIn ? 0 : 1]; }

  std::array<Counts, 2> counts_;
  std::deque<Late> late_;  // by due, then by age
  bool plugged_ = true;
  RigTime replug_at_ = kNever;
  uint32_t damaged_ = 0;
  std::function<void(bool, RigTime)> on_plug_;
};

// A byte of it becomes another one, by more than a low bit; an empty one stays.
void Damage(std::string& message, uint32_t nth);

}  // namespace mesorig::simulator
