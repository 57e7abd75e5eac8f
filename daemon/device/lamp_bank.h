#pragma once
// A bank of lamps with switched channels and read-back light levels.

#include <vector>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// What Safety watches.
struct LampReadings {
  std::vector<double> levels;     // as ReadLevels
  std::vector<double> housing_c;  // of each lamp's housing; empty: the bank does not measure it
};

// Owned and called by one rig thread, except AllOff, which any thread may call, and Watch.
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
  // For the safety thread, a rig thread that is not the owner: no sign of life of whoever lit a
  // lamp. Unavailable also when the bank is left to its communication-loss timeout; Unimplemented
  // for a bank that cannot be watched.
  virtual StatusOr<LampReadings> Watch() { return Unimplemented("the lamp bank cannot be watched"); }
  // Goes to the head of the bus's queue.
  virtual Status AllOff() = 0;
};

}  // namespace mesorig::daemon
