#pragma once
// A bank of lamps with switched channels and read-back light levels.

#include <vector>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// Owned and called by one rig thread, except AllOff, which any thread may call.
class LampBank {
 public:
  virtual ~LampBank() = default;
  // Reads the bank once; Unavailable when it does not answer. Again after it was gone: its
  // connection is made anew by itself.
  virtual Status Open() = 0;
  // Switches on this channel alone (-1: none). Returns when the bank has confirmed the command,
  // not when the light is steady.
  virtual Status SwitchTo(int channel) = 0;
  // Light level of each of the rig's lamps, 0..1 of full flux, read back now. In the order of
  // Rig::lamps.
  virtual StatusOr<std::vector<double>> ReadLevels() = 0;
  // Goes to the head of the bus's queue.
  virtual Status AllOff() = 0;
};

}  // namespace mesorig::daemon
