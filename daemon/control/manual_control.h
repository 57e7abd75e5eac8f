#pragma once
// The rig by hand: jogs, moves, homing, single lamps, a test of the laser (docs/lease.md). Here the
// lease's token is checked where devices are commanded: nothing is commanded for a token that is
// not the newest, and what an older one left on is off before a newer one's first command.

#include <functional>
#include <future>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/control/sequencer.h"
#include "daemon/safety/laser_gate.h"
#include "daemon/safety/safety.h"

namespace mesorig::daemon {

// Borrowed. Axes and lamps in the order of the rig's lists.
struct ManualDevices {
  std::vector<Axis*> axes;
  LampBank* lamps = nullptr;
  LaserGate* gate = nullptr;  // null in a rig without a laser
  StopFlag* stop = nullptr;   // the one that the devices' waits look at
  // The chain is closed, nothing is latched, no plan runs. Any thread.
  std::function<Status()> may_energise;
  // Called as often as a motion is looked at: its thread makes progress.
  std::function<void()> alive = [] {};
  // Whose stops and trips end what is done by hand (Stop); outlives this. Null: of a rig without.
  Safety* safety = nullptr;
};

struct ManualStatus {
  bool open = false;              // somebody has a lease
  bool at_rest = true;            // everything that was on by hand is off
  uint64_t token = 0;             // the newest
  std::string doing;              // "turntable jogs at 5.0 deg/s"; empty: nothing
  std::vector<Reading> readings;  // axes read back, and what was commanded, each with when
};

// Thread-safe: every method from any thread that is no member of the clock. While it is open time
// passes at the pace of the wall clock.
class ManualControl {
 public:
  // A jog ends so long after the last call that asked for it, rig time.
  static constexpr double kHold_s = 0.2;
  static constexpr double kMaxLaser_s = 10;

  static std::unique_ptr<ManualControl> Create(RigClock& clock, const Rig& rig,
                                               ManualDevices devices);
  virtual ~ManualControl() = default;  // everything off first

  // The fence. From now on `token` may command and no other. It is higher than all before it.
  virtual void Admit(uint64_t token) = 0;
  // No token up to this one may command any more: lamps and laser off, axes stopped, torque off.
  // Returns at once; AwaitRest waits for it: Unavailable when it takes longer than `host_s`.
  virtual void Close(uint64_t newest, std::string_view why) = 0;
  virtual Status AwaitRest(double host_s) = 0;
  // Somebody said stop, or Safety tripped: whatever moves or shines ends, torque off; orders given
  // before are refused. What was under way ends with Cancelled and the reason, a jog's next call
  // too (who holds the button must let go first), and a note says it. Takes no lock but the
  // clock's.
  virtual void Stop(std::string_view reason) = 0;

  // Errors of all: FailedPrecondition: the token is not the newest, the chain is open, another
  // motion is under way, or the axis is not referenced; InvalidArgument: no such axis or lamp, or a
  // value out of range; else the device's. Cancelled: stopped, or the lease ended.

  // Runs the axis at this rate (signed) for kHold_s from now; 0: ends the jog. Returns at once: an
  // error that comes later is the next call's, and the listener's. Never beyond the soft limits.
  virtual Status Jog(uint64_t token, int axis, double rate_rad_s) = 0;
  // The future is there when the motion is done, or the lamp or laser was commanded.
  virtual std::future<Status> MoveTo(uint64_t token, int axis, double target_rad) = 0;
  virtual std::future<Status> Home(uint64_t token, int axis) = 0;
  // This lamp alone; -1: none.
  virtual std::future<Status> SetLamp(uint64_t token, int lamp) = 0;
  // The laser shines for so long, at most kMaxLaser_s, then goes off.
  virtual std::future<Status> TestLaser(uint64_t token, double seconds) = 0;

  virtual ManualStatus GetStatus() const = 0;
  // How each order ended, in words; on the manual thread, returns quickly.
  virtual void OnNote(std::function<void(const std::string&)> listener) = 0;
};

}  // namespace mesorig::daemon
