#include "daemon/drivers/cia402/cia402_axis.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "daemon/drivers/driver.h"
#include "protocol/base/log.h"

namespace mesorig::daemon::cia402 {
namespace {

constexpr int16_t kAbortIsFault = 1;
constexpr int16_t kStopThenTorqueOff = 2;  // on the quick stop ramp, then "switch on disabled"
constexpr RigTime kEmergencyDelay{20'000'000};  // an emergency may follow its fault's statusword
constexpr int kDisableAttempts = 3;
constexpr double kLimitSlack_rad = 1e-9;  // limits and targets both come from degrees

}  // namespace

Cia402Axis::Cia402Axis(RigClock& clock, CanBus& bus, const StopFlag& stop,
                       const mesorig::Axis& description, double heartbeat_s, Cia402Options options)
    : clock_(clock),
      bus_(bus),
      stop_(stop),
      axis_(description),
      heartbeat_s_(heartbeat_s),
      options_(options),
      device_(fmt::format("axis {} (node {})", description.name, description.can_node)),
      sdo_(clock, bus, stop, description.can_node, device_, options.answer_timeout) {
  Subscribe();
}

Cia402Axis::~Cia402Axis() {
  for (const int base : {0x080, 0x380, 0x700}) {
    bus_.Unsubscribe(static_cast<uint16_t>(base + axis_.can_node));
  }
}

void Cia402Axis::Subscribe() {
  const auto id = [&](int base) { return static_cast<uint16_t>(base + axis_.can_node); };
  bus_.Subscribe(id(0x380), [this](RigTime time, const CanFrame& frame) {  // TPDO3
    if (frame.size != 6) return;
    seen_.statusword = static_cast<uint16_t>(GetLittle(frame, 0, 2));
    seen_.position = static_cast<int32_t>(GetLittle(frame, 2, 4));
    seen_.read_at = seen_.heard_at = time;
  });
  bus_.Subscribe(id(0x700), [this](RigTime time, const CanFrame& frame) {  // heartbeat
    if (frame.size != 1) return;
    seen_.heard_at = time;
    if (frame.data[0] == 0) ++seen_.boots;
  });
  bus_.Subscribe(id(0x080), [this](RigTime time, const CanFrame& frame) {  // emergency
    if (frame.size != 8) return;
    seen_.heard_at = time;
    seen_.emergency = static_cast<uint16_t>(GetLittle(frame, 0, 2));
  });
}

Cia402Axis::Seen Cia402Axis::seen() const {
  Seen seen;
  clock_.Read([&] { seen = seen_; });
  return seen;
}

double Cia402Axis::CountsPerRad() const { return axis_.counts_per_turn / (2 * kPi); }

uint32_t Cia402Axis::Counts(double rad) const {
  const double counts = std::round(rad * CountsPerRad());
  return static_cast<uint32_t>(std::clamp(counts, 1.0, 4294967295.0));
}

RigTime Cia402Axis::HeartbeatLimit() const {
  return FromSeconds(heartbeat_s_ * options_.heartbeats_missed);
}

AxisReading Cia402Axis::Read() const {
  AxisReading reading;
  const RigTime now = clock_.Now();
  clock_.Read([&] {
    const DriveState state = StateOf(seen_.statusword);
    reading.position_rad = seen_.position / CountsPerRad();
    reading.read_at = seen_.read_at;
    reading.enabled = enabled_ && state == DriveState::kOperationEnabled;
    reading.referenced = referenced_ && seen_.boots == boots_at_enable_;
    reading.moving = state == DriveState::kQuickStopActive ||
                     (reading.enabled && (seen_.statusword & kTargetReached) == 0);
    reading.fault = state == DriveState::kFault || state == DriveState::kFaultReactionActive;
    reading.torque = (state == DriveState::kOperationEnabled ||
                      state == DriveState::kQuickStopActive) &&
                     now < seen_.heard_at + HeartbeatLimit();
  });
  return reading;
}

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

Status Cia402Axis::RefreshStatus(Heed heed) {
  MESORIG_ASSIGN_OR_RETURN(const uint32_t statusword, sdo_.Read(kStatusword, heed));
  MESORIG_ASSIGN_OR_RETURN(const uint32_t position, sdo_.Read(kActualPosition, heed));
  const RigTime now = clock_.Now();
  clock_.Change([&] {
    seen_.statusword = static_cast<uint16_t>(statusword);
    seen_.position = static_cast<int32_t>(position);
    seen_.read_at = seen_.heard_at = now;
  });
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

Status Cia402Axis::CheckReady(bool needs_reference) const {
  const AxisReading reading = Read();
  if (!reading.enabled) {
    return FailedPrecondition("{}: not enabled; the drive is in \"{}\"", device_, Text(state()));
  }
  if (needs_reference && !reading.referenced) {
    return FailedPrecondition("{}: not referenced since power-on", device_);
  }
  return OkStatus();
}

Status Cia402Axis::SendSetPoint(uint16_t controlword, int32_t target) {
  CanFrame frame{static_cast<uint16_t>(0x400 + axis_.can_node), 6, {}};
  PutLittle(frame, 0, 2, controlword);
  PutLittle(frame, 2, 4, static_cast<uint32_t>(target));
  return Annotate(bus_.Send(frame), device_);
}

Status Cia402Axis::StartMove(double target_rad) {
  if (!(target_rad >= axis_.min_rad - kLimitSlack_rad &&
        target_rad <= axis_.max_rad + kLimitSlack_rad)) {
    return InvalidArgument("{}: target {:.4f} deg is not in [{:.4f}, {:.4f}] deg", device_,
                           DegFromRad(target_rad), DegFromRad(axis_.min_rad),
                           DegFromRad(axis_.max_rad));
  }
  const double counts = std::round(target_rad * CountsPerRad());
  if (std::abs(counts) > std::numeric_limits<int32_t>::max()) {
    return InvalidArgument("{}: target of {:.0f} counts does not fit 32 bits", device_, counts);
  }
  MESORIG_RETURN_IF_ERROR(CheckReady(true));
  clock_.Change([&] { target_ = static_cast<int32_t>(counts); });

  // Set-point handshake (CiA 402-2, profile position): the acknowledge of the last one is gone,
  // bit 4 rises, the drive acknowledges, bit 4 falls.
  const RigTime deadline = clock_.Now() + options_.answer_timeout;
  MESORIG_RETURN_IF_ERROR(AwaitStatus(
      deadline, [](uint16_t word) { return (word & kSetPointAcknowledged) == 0; },
      "the acknowledge of the last set-point to go"));
  MESORIG_RETURN_IF_ERROR(SendSetPoint(kEnableOperation | kStartBit, target_));
  MESORIG_RETURN_IF_ERROR(AwaitStatus(
      deadline, [](uint16_t word) { return (word & kSetPointAcknowledged) != 0; },
      "the acknowledge of a set-point"));
  return SendSetPoint(kEnableOperation, target_);
}

Status Cia402Axis::SetSpeed(double rad_s) {
  if (!(rad_s > 0 && rad_s <= axis_.max_velocity_rad_s)) {
    return InvalidArgument("{}: speed {:.4g} deg/s is not in (0, {:.4g}] deg/s", device_,
                           DegFromRad(rad_s), DegFromRad(axis_.max_velocity_rad_s));
  }
  return sdo_.Write(kProfileVelocity, Counts(rad_s));
}

std::string Cia402Axis::Angles(int32_t position) const {
  return fmt::format("commanded {:.4f} deg, it stands at {:.4f} deg",
                     DegFromRad(target_ / CountsPerRad()), DegFromRad(position / CountsPerRad()));
}

Status Cia402Axis::AwaitMove(RigTime deadline) {
  // Bit 10 fell, or was confirmed, with the acknowledge that StartMove saw.
  const Status waited = AwaitStatus(
      deadline, [](uint16_t word) { return (word & (kTargetReached | kFollowingError)) != 0; },
      "target reached");
  const Seen now_seen = seen();
  if (absl::IsDeadlineExceeded(waited)) {
    return DeadlineExceeded("{}: target not reached until {:.3f} s: {}", device_,
                            Seconds(clock_.Now()), Angles(now_seen.position));
  }
  MESORIG_RETURN_IF_ERROR(waited);
  return CheckPosition(now_seen);
}

Status Cia402Axis::CheckPosition(const Seen& now_seen) const {
  if ((now_seen.statusword & kFollowingError) != 0) {
    return Unavailable("{}: following error (stuck, or steps were lost): {}", device_,
                       Angles(now_seen.position));
  }
  const double off = std::abs(static_cast<double>(now_seen.position) - target_);
  if (off > options_.position_window_counts) {
    return Unavailable("{}: the drive says target reached, its encoder another place: {}", device_,
                       Angles(now_seen.position));
  }
  return OkStatus();
}

Status Cia402Axis::CheckHolds() const {
  const AxisReading reading = Read();
  if (!reading.enabled || !reading.referenced || reading.moving) {
    return Unavailable("{}: does not hold its place ({})", device_,
                       !reading.enabled      ? fmt::format("the drive is in \"{}\"", Text(state()))
                       : !reading.referenced ? "not referenced"
                                             : "it moves");
  }
  return CheckPosition(seen());
}

Status Cia402Axis::StartHoming() {
  MESORIG_RETURN_IF_ERROR(CheckReady(false));
  had_reference_ = Read().referenced;
  clock_.Change([&] { referenced_ = false; });
  MESORIG_RETURN_IF_ERROR(sdo_.Write(kModeOfOperation, kHomingMode));
  return sdo_.Write(kControlword, kEnableOperation | kStartBit);
}

Status Cia402Axis::AwaitHoming(RigTime deadline) {
  MESORIG_RETURN_IF_ERROR(AwaitStatus(
      deadline,
      [](uint16_t word) {
        const bool found = (word & kHomingAttained) != 0 && (word & kTargetReached) != 0;
        return found || (word & kHomingError) != 0;
      },
      "the end of homing"));
  if ((seen().statusword & kHomingError) != 0) return Unavailable("{}: homing error", device_);
  MESORIG_RETURN_IF_ERROR(sdo_.Write(kControlword, kEnableOperation));
  MESORIG_RETURN_IF_ERROR(sdo_.Write(kModeOfOperation, kProfilePositionMode));
  MESORIG_RETURN_IF_ERROR(RefreshStatus(Heed::kStop));
  clock_.Change([&] {
    referenced_ = true;
    target_ = seen_.position;
  });
  return CheckReferenceFound();
}

// (The new reference is good; what was done since the last one may not be.)
Status Cia402Axis::CheckReferenceFound() {
  if (!std::exchange(had_reference_, false)) return OkStatus();
  const auto found = sdo_.Read(kReferenceFound);
  if (!found.ok()) {
    // A drive without this object cannot tell.
    return absl::IsUnavailable(found.status()) ? OkStatus() : found.status();
  }
  const double off_rad = static_cast<int32_t>(*found) / CountsPerRad();
  if (std::abs(off_rad) <= axis_.reference_tolerance_rad) return OkStatus();
  return DataLoss(
      "{}: homing found the reference at {:.4f} deg by the count, permitted is 0 within {:g} deg: "
      "steps were lost, or the axis slipped, since it was homed last; what was measured since then "
      "may have been measured elsewhere",
      device_, DegFromRad(off_rad), DegFromRad(axis_.reference_tolerance_rad));
}

Status Cia402Axis::AwaitStatus(RigTime deadline, const std::function<bool(uint16_t)>& done,
                               std::string_view what) {
  for (;;) {
    const RigTime silent_at = seen().heard_at + HeartbeatLimit();
    const Status waited = stop_.Wait(std::min(deadline, silent_at), [&] {
      return StateOf(seen_.statusword) != DriveState::kOperationEnabled ||
             seen_.boots != boots_at_enable_ || done(seen_.statusword);
    });
    if (absl::IsCancelled(waited)) return waited;
    const Seen now_seen = seen();
    if (now_seen.boots != boots_at_enable_) {
      clock_.Change([&] { enabled_ = referenced_ = false; });
      return Unavailable("{}: the drive restarted while waiting for {}", device_, what);
    }
    if (StateOf(now_seen.statusword) != DriveState::kOperationEnabled) return WhyNotRunning();
    if (waited.ok()) return OkStatus();
    const RigTime now = clock_.Now();
    if (now >= deadline) {
      const Status asked = RefreshStatus(Heed::kStop);
      if (absl::IsCancelled(asked)) return asked;
      if (asked.ok() && done(seen().statusword)) return OkStatus();
      return DeadlineExceeded("{}: waiting for {}: not until {:.3f} s; it stands at {:.4f} deg",
                              device_, what, Seconds(now),
                              DegFromRad(seen().position / CountsPerRad()));
    }
    if (now >= now_seen.heard_at + HeartbeatLimit()) {
      return Unavailable("{}: no heartbeat for {} s while waiting for {}", device_,
                         Seconds(HeartbeatLimit()), what);
    }
  }
}

Status Cia402Axis::WhyNotRunning() {
  clock_.Change([&] { enabled_ = false; });
  const DriveState left_to = state();
  const bool fault = left_to == DriveState::kFault || left_to == DriveState::kFaultReactionActive;
  if (!fault) {
    return Unavailable("{}: the drive left \"operation enabled\" for \"{}\"", device_,
                       Text(left_to));
  }
  clock_.WaitFor(kEmergencyDelay, [&] { return seen_.emergency != 0; });
  const uint16_t code = seen().emergency;
  return Unavailable("{}: drive fault {}", device_,
                     code == 0 ? "without an emergency message" : EmergencyText(code));
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

Driver Describe() {
  Driver driver;
  driver.make_axis = [](const DriverContext& context,
                        int index) -> StatusOr<std::unique_ptr<Axis>> {
    const mesorig::Axis& axis = context.rig->axes.at(index);
    if (context.can == nullptr) {
      return FailedPrecondition("axis {}: driver cia402 needs a CAN bus, and there is none",
                                axis.name);
    }
    return std::make_unique<Cia402Axis>(*context.clock, *context.can, *context.stop, axis,
                                        context.rig->heartbeat_s);
  };
  return driver;
}

}  // namespace mesorig::daemon::cia402
