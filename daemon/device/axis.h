#pragma once
// A positioning axis with homing. Owned and called by one rig thread (the sequencer's); waits in
// rig time; a wait on behalf of a plan ends with Cancelled when the StopFlag is raised
// (stop_flag.h). Angles in radians, zero at home, sign as in the rig file.

#include <string>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

struct AxisReading {
  double position_rad = 0;  // read back from the encoder
  RigTime read_at{};        // when the device said so
  bool enabled = false;     // drive torque is on
  bool referenced = false;  // homed since power-on
  bool moving = false;
  bool fault = false;
  bool torque = false;  // by what the drive said last, and it still speaks
};

class Axis {
 public:
  virtual ~Axis() = default;
  virtual const std::string& name() const = 0;
  // Configures the drive and switches torque on; again after the drive was gone, too. A drive that
  // restarted meanwhile is not referenced any more. DeadlineExceeded: no answer; Unavailable: the
  // drive refuses a setting; FailedPrecondition: a fault that a fault reset does not clear.
  virtual Status Enable() = 0;
  // Torque off, after a quick stop has come to rest. OK when it is off already.
  virtual Status Disable() = 0;
  // Begins to search the reference and returns. FailedPrecondition when not enabled.
  virtual Status StartHoming() = 0;
  // Blocks until the reference is found; errors as AwaitMove. DataLoss: it was found, but not where
  // the count of the reference before had it (Axis::reference_tolerance_rad): steps were lost since.
  virtual Status AwaitHoming(RigTime deadline) = 0;
  // Begins a move and returns. InvalidArgument beyond the soft limits; FailedPrecondition when not
  // enabled or not referenced.
  virtual Status StartMove(double target_rad) = 0;
  // The speed of the moves that begin from now on, until Enable makes it the rig's fastest again.
  // InvalidArgument beyond (0, max_velocity_rad_s].
  virtual Status SetSpeed(double rad_s) { return Unimplemented("{}: speed {}", name(), rad_s); }
  // Blocks until the target is reached (read back within the rig's tolerance), at most until
  // `deadline` (DeadlineExceeded), or until the drive reports a fault (Unavailable names it). An axis
  // that does not follow, or comes to rest somewhere else (stuck, lost steps), is Unavailable; the
  // message has both angles. A loss of steps is mended by Enable after Disable, not by another move.
  virtual Status AwaitMove(RigTime deadline) = 0;
  // OK while the axis stands where the last move (or homing) put it, with torque, by what the drive
  // said last; else Unavailable as AwaitMove. For the instants around an exposure.
  virtual Status CheckHolds() const { return {}; }
  // Commands the fastest permitted deceleration, after which the drive switches torque off by
  // itself, and returns without waiting. Callable at any time from any thread, also while the
  // StopFlag is raised or the owner is inside another call.
  virtual Status QuickStop() = 0;
  // The last reading; never a commanded value. Any thread.
  virtual AxisReading Read() const = 0;
};

}  // namespace mesorig::daemon
