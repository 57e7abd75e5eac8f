// Torque: starting the node, its settings, on, and off again.

#include "daemon/drivers/cia402/cia402_axis.h"

#include <cmath>
#include <utility>

#include "protocol/base/log.h"

namespace mesorig::daemon::cia402 {
namespace {

constexpr int16_t kAbortIsFault = 1;
constexpr int16_t kStopThenTorqueOff = 2;  // on the quick stop ramp, then "switch on disabled"
constexpr int kDisableAttempts = 3;

}  // namespace

Status Cia402Axis::Enable() {
  MESORIG_RETURN_IF_ERROR(StartNode());
  MESORIG_RETURN_IF_ERROR(WriteSettings());
  MESORIG_RETURN_IF_ERROR(bus_.SendHeartbeat());  // from now on the drive watches us
  MESORIG_RETURN_IF_ERROR(ReachOperationEnabled());
  clock_.Change([&] {
    enabled_ = true;
    quick_stopping_ = false;
    seen_.emergency = 0;
  });
  return OkStatus();
}

Status Cia402Axis::StartNode() {
  MESORIG_RETURN_IF_ERROR(bus_.Send({0x000, 2, {0x01, static_cast<uint8_t>(axis_.can_node)}}));
  MESORIG_RETURN_IF_ERROR(RefreshStatus(Heed::kStop));
  MESORIG_RETURN_IF_ERROR(NoticeRestart());
  clock_.Change([&] {
    started_ = true;
    // A node that booted since has lost its reference.
    if (seen_.boots != boots_at_enable_) referenced_ = false;
    boots_at_enable_ = seen_.boots;
    target_ = seen_.position;
  });
  return OkStatus();
}

uint32_t Cia402Axis::ConsumerHeartbeat() const {
  return uint32_t{bus_.options().node_id} << 16 |
         static_cast<uint32_t>(Seconds(HeartbeatLimit()) * 1000);
}

Status Cia402Axis::NoticeRestart() {
  if (!Read().referenced) return OkStatus();
  MESORIG_ASSIGN_OR_RETURN(const uint32_t consumer, sdo_.Read(kConsumerHeartbeat));
  if (consumer == ConsumerHeartbeat()) return OkStatus();
  Log("drivers").warn("{}: its settings are gone: it restarted and has lost its reference", device_);
  clock_.Change([&] { referenced_ = false; });
  return OkStatus();
}

Status Cia402Axis::WriteSettings() {
  const auto period_ms = static_cast<uint32_t>(heartbeat_s_ * 1000);
  const uint32_t acceleration = Counts(axis_.acceleration_rad_s2);
  const struct {
    Object object;
    uint32_t value;
  } settings[] = {
      {kConsumerHeartbeat, ConsumerHeartbeat()},
      {kProducerHeartbeat, period_ms},
      {kAbortOption, static_cast<uint16_t>(kAbortIsFault)},
      {kQuickStopOption, static_cast<uint16_t>(kStopThenTorqueOff)},
      {kFollowingErrorWindow, Counts(options_.following_window_rad)},
      {kProfileVelocity, Counts(axis_.max_velocity_rad_s)},
      {kProfileAcceleration, acceleration},
      {kProfileDeceleration, acceleration},
      {kHomingMethod, static_cast<uint8_t>(options_.homing_method)},
      {kHomingSearchSpeed, Counts(axis_.homing_velocity_rad_s)},
      {kHomingZeroSpeed, Counts(axis_.homing_velocity_rad_s / 10)},
      {kHomingAcceleration, acceleration},
      {kModeOfOperation, kProfilePositionMode},
  };
  for (const auto& [object, value] : settings) MESORIG_RETURN_IF_ERROR(sdo_.Write(object, value));
  return WriteLimits();
}

// Beyond them the drive does not go, whoever asks and whatever arrives.
Status Cia402Axis::WriteLimits() {
  const struct {
    Object object;
    double limit_rad;
  } limits[] = {{kLowerLimit, axis_.min_rad}, {kUpperLimit, axis_.max_rad}};
  for (const auto& [object, limit_rad] : limits) {
    const auto counts = static_cast<int32_t>(std::lround(limit_rad * CountsPerRad()));
    MESORIG_RETURN_IF_ERROR(sdo_.Write(object, static_cast<uint32_t>(counts)));
    MESORIG_ASSIGN_OR_RETURN(const uint32_t read, sdo_.Read(object));
    const auto holds = static_cast<int32_t>(read);
    if (holds == counts) continue;
    return Unavailable("{}: {} reads back as {} counts ({:.4f} deg), {} counts ({:.4f} deg) were written",
                       device_, object.name, holds, DegFromRad(holds / CountsPerRad()), counts,
                       DegFromRad(limit_rad));
  }
  return OkStatus();
}

Status Cia402Axis::Transition(uint16_t controlword, DriveState from, Heed heed) {
  MESORIG_RETURN_IF_ERROR(sdo_.Write(kControlword, controlword, heed));
  const RigTime deadline = clock_.Now() + options_.answer_timeout;
  const auto changed = [&] { return StateOf(seen_.statusword) != from; };
  const Status waited = heed == Heed::kStop                   ? stop_.Wait(deadline, changed)
                        : clock_.WaitUntil(deadline, changed) ? OkStatus()
                                                              : DeadlineExceeded("no change");
  if (waited.ok() || absl::IsCancelled(waited)) return waited;
  // Its TPDO may be lost or not configured.
  MESORIG_RETURN_IF_ERROR(RefreshStatus(heed));
  if (state() != from) return OkStatus();
  return FailedPrecondition(
      "{}: stays in \"{}\" after controlword 0x{:04X}{}", device_, Text(from), controlword,
      seen().emergency == 0 ? std::string()
                            : "; its last emergency: " + EmergencyText(seen().emergency));
}

Status Cia402Axis::ReachOperationEnabled() {
  bool reset = false;
  for (int step = 0; step < 12; ++step) {
    const DriveState now = state();
    switch (now) {
      case DriveState::kOperationEnabled:
        return OkStatus();
      case DriveState::kFault:
        if (reset) {
          return FailedPrecondition("{}: fault {} comes again after a fault reset", device_,
                                    EmergencyText(seen().emergency));
        }
        reset = true;
        MESORIG_RETURN_IF_ERROR(sdo_.Write(kControlword, kDisableVoltage));  // for an edge of bit 7
        MESORIG_RETURN_IF_ERROR(Transition(kFaultReset, now, Heed::kStop));
        break;
      case DriveState::kQuickStopActive:
        MESORIG_RETURN_IF_ERROR(Transition(kDisableVoltage, now, Heed::kStop));
        break;
      case DriveState::kSwitchOnDisabled:
        MESORIG_RETURN_IF_ERROR(Transition(kShutdown, now, Heed::kStop));
        break;
      case DriveState::kReadyToSwitchOn:
        MESORIG_RETURN_IF_ERROR(Transition(kSwitchOn, now, Heed::kStop));
        break;
      case DriveState::kSwitchedOn:
        MESORIG_RETURN_IF_ERROR(Transition(kEnableOperation, now, Heed::kStop));
        break;
      case DriveState::kNotReadyToSwitchOn:
      case DriveState::kFaultReactionActive:  // pass by themselves
        MESORIG_RETURN_IF_ERROR(Transition(kDisableVoltage, now, Heed::kStop));
        break;
    }
  }
  return FailedPrecondition("{}: does not come to rest in \"operation enabled\"; it is in \"{}\"",
                            device_, Text(state()));
}

Status Cia402Axis::QuickStop() {
  bool known = false;
  int32_t target = 0;
  clock_.Change([&] {
    known = started_;
    quick_stopping_ = known;
    target = target_;
  });
  return known ? SendSetPoint(kQuickStopCommand, target) : OkStatus();
}

Status Cia402Axis::Disable() {
  bool known = false, stopping = false;
  clock_.Change([&] {
    known = started_;
    stopping = std::exchange(quick_stopping_, false);
    enabled_ = false;
  });
  if (!known) return OkStatus();
  if (stopping) {
    // Torque brakes until the axis stands; a drive that says nothing has had the time it takes.
    const double brake_s = axis_.max_velocity_rad_s / axis_.acceleration_rad_s2;
    clock_.WaitFor(FromSeconds(brake_s) + options_.answer_timeout, [&] {
      const DriveState now = StateOf(seen_.statusword);
      const bool stands = (seen_.statusword & kTargetReached) != 0;
      return (now != DriveState::kOperationEnabled && now != DriveState::kQuickStopActive) ||
             (now == DriveState::kQuickStopActive && stands);
    });
  }
  Status status;
  for (int attempt = 0; attempt < kDisableAttempts; ++attempt) {
    status = SwitchTorqueOff();
    if (status.ok()) return status;
  }
  // It may hear what it does not answer; and one that does not hear misses the daemon's heartbeat.
  (void)SendSetPoint(kDisableVoltage, target_);
  clock_.WaitFor(HeartbeatLimit() + options_.answer_timeout, [] { return false; });
  return status;
}

Status Cia402Axis::SwitchTorqueOff() {
  MESORIG_RETURN_IF_ERROR(RefreshStatus(Heed::kNothing));
  const DriveState now = state();
  const bool torque = now == DriveState::kReadyToSwitchOn || now == DriveState::kSwitchedOn ||
                      now == DriveState::kOperationEnabled || now == DriveState::kQuickStopActive;
  return torque ? Transition(kDisableVoltage, now, Heed::kNothing) : OkStatus();
}

}  // namespace mesorig::daemon::cia402
