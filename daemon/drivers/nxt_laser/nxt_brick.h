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
};

// Of one rig thread. Borrows clock and port.
class NxtBrick {
 public:
  NxtBrick(RigClock& clock, UsbPort& port);
  ~NxtBrick();

  // Motor on at a regulated speed, power in -100..100. `limit_deg` > 0: it stops itself after so
  // many degrees; 0: it runs until told otherwise.
  Status Run(int motor, int power, uint32_t limit_deg);
  // Lets go: a worm gear holds by itself.
  Status Halt(int motor);
  Status ResetPosition(int motor);
  StatusOr<OutputState> GetOutput(int motor);
  StatusOr<double> BatteryVolts();
  // Restarts the brick's sleep timer; returns its limit, s (0: never sleeps).
  StatusOr<double> KeepAlive();

 private:
  // `size` of the whole reply. Unavailable: no answer within a second, or the brick's error code.
  StatusOr<std::string> Exchange(std::string_view what, std::string telegram, size_t size);

  RigClock& clock_;
  UsbPort& port_;
  RigQueue<std::string> replies_;
};

}  // namespace mesorig::daemon::nxt_laser
