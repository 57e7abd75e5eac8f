#pragma once
// The last values that were read back from the rig, each with when, and what became of frames that
// were not as they should be, for whoever asks for the status.

#include <vector>

#include "daemon/control/sequencer.h"
#include "daemon/safety/interlock_chain.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

// Thread-safe: the sequencer writes, anybody reads.
class ReadingBoard {
 public:
  explicit ReadingBoard(const Rig& rig);  // borrowed
  void SetAxis(size_t axis, const AxisReading& reading);
  void SetLevels(const std::vector<double>& levels, RigTime read_at);
  void SetChain(const InterlockChain::Levels& levels);
  void Count(const FrameTrouble& more);
  FrameTrouble trouble() const;
  // Axes (rad), lamps (1 = full flux), then chain (1 = closed). What was never read is left out.
  std::vector<Reading> Get() const;

 private:
  struct Slot {
    Reading reading;
    bool read = false;
  };
  void Set(size_t slot, double value, RigTime read_at) REQUIRES(mutex_);

  const size_t axes_, lamps_;
  mutable Mutex mutex_;
  std::vector<Slot> slots_ GUARDED_BY(mutex_);
  FrameTrouble trouble_ GUARDED_BY(mutex_);
};

}  // namespace mesorig::daemon
