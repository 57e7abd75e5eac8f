#pragma once
// A line laser on a tilting emitter (docs/laser.md). Light is not switched here: the gate is the
// safety folder's (LaserGate). Tilts in radians of the emitter as the motor's tachometer tells them,
// less the gear's backlash and slip: where the sheet really is, only the image tells.

#include <string>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

struct LaserReading {
  double tilt_rad = 0;
  bool moving = false;
  RigTime read_at{};
};

// Owned and called by one rig thread (the sequencer's). A wait on behalf of a plan ends with
// Cancelled when the StopFlag is raised; Stop does not look at it.
class LineLaser {
 public:
  virtual ~LineLaser() = default;
  virtual const std::string& name() const = 0;
  // Finds the unit and stops its motor; again after it was gone. Unavailable: no answer, or its
  // battery is low. A unit that was off meanwhile has lost its zero: what needs it is then
  // Unavailable until MarkZero.
  virtual Status Open() = 0;
  // The emitter stands where its sheet passes through the turntable's centre: tilt 0 from now on.
  virtual Status MarkZero() = 0;
  // Brings the emitter to rest so far before `tilt_rad` that a sweep at `rate_rad_s` (signed) passes
  // there at a steady speed and with the gear's play taken up. Blocks. InvalidArgument beyond the
  // rig's tilt range, or for a rate that is zero or that the motor cannot do.
  virtual Status Prepare(double tilt_rad, double rate_rad_s) = 0;
  // Begins to sweep and returns the rate that the motor will do: of the ones it has, the next not
  // faster than `rate_rad_s`. Errors as Prepare.
  virtual StatusOr<double> StartSweep(double rate_rad_s) = 0;
  // Blocks until the tachometer says that the sweep has passed `tilt_rad`. DeadlineExceeded.
  virtual Status AwaitTilt(double tilt_rad, RigTime deadline) = 0;
  virtual StatusOr<LaserReading> Read() = 0;
  // Motor off, at once. Any state.
  virtual Status Stop() = 0;
  // Keeps the unit from switching itself off; asks it only when that is due.
  virtual Status KeepAlive() = 0;
};

}  // namespace mesorig::daemon
