#pragma once
// The laser's gate. A retriggerable one-shot at the rig holds the laser on for kLaserOneShot_s
// after each rising edge of its line: this thread gives the edges, and only while the sequencer
// says that it makes progress, within the time that its sweep was given, and while Safety permits
// (no axis moves). Whoever dies, hangs or forgets, the laser goes off by itself.

#include <functional>

#include "daemon/device/digital_lines.h"
#include "daemon/device/rig_thread.h"
#include "daemon/device/stop_flag.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

// Thread contract: Open, Progress, Close and the waits on the sequencer's thread; Shut from any.
// Borrows everything; `lines` may be null in a rig without a laser.
class LaserGate {
 public:
  static constexpr double kPetPeriod_s = 0.1;
  // Edges end when the sequencer has not reported progress for so long, rig time.
  static constexpr double kProgressLimit_s = 1;

  // `permit` is asked before each edge, without the clock's lock; null: always OK.
  LaserGate(RigClock& clock, DigitalLines* lines, const Lines& numbers, StopFlag& stop,
            std::function<Status()> permit = nullptr);
  ~LaserGate();

  // Edges from now on, until Close, `until` (the end of the sweep), a raised StopFlag, no progress
  // or no permit. Returns when the laser shines (read back); Unavailable when it does not within the
  // one-shot's time, FailedPrecondition in a rig without the lines, or why it is not permitted.
  Status Open(RigTime until = kNever);
  void Progress();
  // No more edges; returns when the laser is read back as off. Unavailable when it stays on.
  Status Close();
  // No more edges, at once; does not wait.
  void Shut();
  StatusOr<bool> Shines() const;
  bool open() const;  // edges are given
  bool OpenInsideChange() const { return open_; }

 private:
  void Loop();
  Status AwaitLevel(bool on);

  RigClock& clock_;
  DigitalLines* const lines_;
  const Lines numbers_;
  StopFlag& stop_;
  const std::function<Status()> permit_;
  // Guarded by the clock's lock:
  bool open_ = false, ending_ = false;
  RigTime progress_{}, until_ = kNever, shut_at_ = RigTime::min();
  RigThread thread_;
};

}  // namespace mesorig::daemon
