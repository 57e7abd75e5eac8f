#pragma once
// The NXT's direct commands, as far as a tilting emitter needs them. One exchange at a time: a
// telegram out, its reply in (about 7 ms).

#include <cstdint>
#include <functional>
#include <string>

#include "daemon/bus/usb_port.h"
#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::daemon::nxt_laser {

struct OutputState {
  int power = 0;             // -100..100
  bool running = false;      // the run state is not idle
  int32_t rotation_deg = 0;  // since the last ResetPosition
  int32_t tacho_deg = 0;     // since the brick was switched on
};

struct Versions {
  int protocol_major = 0, protocol_minor = 0, firmware_major = 0, firmware_minor = 0;
};

// What came wrong since the brick was opened first.
struct NxtCounts {
  uint64_t unanswered = 0;  // telegrams without a reply in time
  uint64_t foreign = 0;     // replies to an earlier telegram, which came late: passed over
  uint64_t damaged = 0;     // no reply to any telegram, or of another size
  uint64_t refused = 0;     // with an error code
  uint64_t unasked = 0;     // packets beyond those that a brick may owe: thrown away
};

// Of one rig thread. Borrows clock and port.
class NxtBrick {
 public:
  NxtBrick(RigClock& clock, UsbPort& port);
  ~NxtBrick();

  // Motor on at a regulated speed, power in -100..100. `limit_deg` > 0: it stops itself after so
  // many degrees; 0: it runs until told otherwise.
  Status Run(int motor, int power, uint32_t limit_deg);
  // Stops the motor where it is, and holds it until the next command.
  Status Brake(int motor);
  // Lets go: a worm gear holds by itself.
  Status Halt(int motor);
  Status ResetPosition(int motor);
  StatusOr<OutputState> GetOutput(int motor);
  StatusOr<double> BatteryVolts();
  StatusOr<Versions> ReadVersions();
  // Restarts the brick's sleep timer; returns its limit, s (0: never sleeps).
  StatusOr<double> KeepAlive();
  NxtCounts counts() const;

 private:
  // `size` of the whole reply. Unavailable: no answer within a second, or the brick's error code.
  StatusOr<std::string> Exchange(std::string_view what, std::string telegram, size_t size);
  StatusOr<std::string> ExchangeOnce(std::string_view what, const std::string& telegram,
                                     size_t size);
  // Replies have no number. After one that did not come, asks for something else: what comes before
  // that answer is late.
  Status Resync(char failed_command);

  RigClock& clock_;
  UsbPort& port_;
  RigQueue<std::string> replies_;
  uint64_t unasked_ = 0;   // guarded by the clock's lock
  char lost_command_ = 0;  // whose reply may still come; 0: none
  NxtCounts counts_;
};

}  // namespace mesorig::daemon::nxt_laser
