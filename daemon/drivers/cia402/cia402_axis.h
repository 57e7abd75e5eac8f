#pragma once
// An axis behind a CiA 402 drive: profile position (mode 1) and homing (mode 6).
//
// Positions on the wire are counts = rad / (2 pi) * counts_per_turn; velocities counts/s,
// accelerations counts/s^2. Owned by one rig thread; what the bus thread stores is guarded by the
// clock's lock. The soft limits are the drive's as well (0x607D), read back at each Enable.

#include <cstdint>
#include <optional>
#include <string>

#include "daemon/bus/can_bus.h"
#include "daemon/device/axis.h"
#include "daemon/device/stop_flag.h"
#include "daemon/drivers/cia402/objects.h"
#include "daemon/drivers/cia402/sdo_client.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon::cia402 {

struct Cia402Options {
  RigTime answer_timeout{500'000'000};  // of one SDO, one state transition, one handshake
  double position_window_counts = 10;   // "there" when the drive says so and the encoder agrees
  double following_window_rad = 2 * kPi / 180;  // demand less encoder; beyond, the drive says so
  int8_t homing_method = 24;            // home switch, positive initial direction
  int heartbeats_missed = 3;            // then the other side is taken for dead
};

class Cia402Axis final : public Axis {
 public:
  // Borrows clock, bus and flag. `heartbeat_s`: of the daemon and of the node.
  Cia402Axis(RigClock& clock, CanBus& bus, const StopFlag& stop, const mesorig::Axis& description,
             double heartbeat_s, Cia402Options options = {});
  ~Cia402Axis() override;

  const std::string& name() const override { return axis_.name; }
  Status Enable() override;
  Status Disable() override;
  Status StartHoming() override;
  Status AwaitHoming(RigTime deadline) override;
  Status StartMove(double target_rad) override;
  Status SetSpeed(double rad_s) override;
  Status AwaitMove(RigTime deadline) override;
  Status CheckHolds() const override;
  Status QuickStop() override;
  AxisReading Read() const override;

 private:
  // What the node said. Guarded by the clock's lock.
  struct Seen {
    uint16_t statusword = 0;
    int32_t position = 0;  // counts
    RigTime read_at{};
    RigTime heard_at{};      // any frame
    uint32_t boots = 0;      // boot-up messages
    uint16_t emergency = 0;  // last error code; 0 after its reset
  };
  void Subscribe();
  Seen seen() const;
  DriveState state() const { return StateOf(seen().statusword); }

  Status StartNode();
  // A node whose settings are gone was without supply, though its boot-up message was not heard.
  Status NoticeRestart();
  uint32_t ConsumerHeartbeat() const;
  Status WriteSettings();
  Status WriteLimits();
  Status ReachOperationEnabled();
  // One controlword by SDO, then until the state is another one.
  Status Transition(uint16_t controlword, DriveState from, Heed heed);
  Status RefreshStatus(Heed heed);
  Status SendSetPoint(uint16_t controlword, int32_t target);
  // Until `done` (of the statusword) or what makes waiting pointless: fault, torque gone, reboot,
  // no heartbeat, stop, deadline.
  // A wait that comes to its deadline asks the drive itself: its message may have been lost.
  Status AwaitStatus(RigTime deadline, const std::function<bool(uint16_t)>& done,
                     std::string_view what);
  Status WhyNotRunning();
  // One try of Disable.
  Status SwitchTorqueOff();
  Status CheckPosition(const Seen& now_seen) const;  // against the target
  std::string Angles(int32_t position) const;  // "commanded 30 deg, stands at 12 deg"
  Status CheckReady(bool needs_reference) const;
  Status CheckReferenceFound();

  double CountsPerRad() const;
  uint32_t Counts(double rad) const;  // of a velocity or acceleration, at least 1
  RigTime HeartbeatLimit() const;

  RigClock& clock_;
  CanBus& bus_;
  const StopFlag& stop_;
  const mesorig::Axis axis_;
  const double heartbeat_s_;
  const Cia402Options options_;
  const std::string device_;  // "axis turntable (node 1)"
  SdoClient sdo_;
  Seen seen_;

  // Of the owner, guarded by the clock's lock where Read() looks at them from a status request.
  bool started_ = false, enabled_ = false, referenced_ = false, quick_stopping_ = false;
  bool had_reference_ = false;  // when homing began: the count must find it where it is
  uint32_t boots_at_enable_ = 0;
  int32_t target_ = 0;  // counts, of the last set-point
};

}  // namespace mesorig::daemon::cia402
