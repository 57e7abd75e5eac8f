#include "daemon/drivers/cia402/cia402_axis.h"

#include <algorithm>
#include <cmath>

#include "daemon/drivers/driver.h"

namespace mesorig::daemon::cia402 {
namespace {

constexpr RigTime kEmergencyDelay{20'000'000};  // an emergency may follow its fault's statusword

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

std::string Cia402Axis::Angles(int32_t position) const {
  return fmt::format("commanded {:.4f} deg, it stands at {:.4f} deg",
                     DegFromRad(target_ / CountsPerRad()), DegFromRad(position / CountsPerRad()));
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
