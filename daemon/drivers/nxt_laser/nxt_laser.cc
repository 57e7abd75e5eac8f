#include <algorithm>
#include <cmath>
#include <optional>

#include "daemon/device/line_laser.h"
#include "daemon/drivers/driver.h"
#include "daemon/drivers/nxt_laser/nxt_brick.h"

namespace mesorig::daemon::nxt_laser {
namespace {

constexpr int kProtocol = 1;           // of direct commands, the major number
constexpr double kMinBattery_v = 6.5;  // six cells of 1.2 V, nearly empty
constexpr int kTravelPower = 60, kApproachPower = 20;
constexpr double kApproach_deg = 60;           // the last leg, always in the sweep's direction
constexpr double kRunUp_s = 0.3;               // until a sweep's speed is steady
constexpr double kPositionTolerance_deg = 10;  // of the motor, after a travel
constexpr int kTravelAttempts = 3;
constexpr int kStandingReadings = 5;  // the same in a row: the motor stands
constexpr double kBraking_s = 1;      // enough to stop from full speed
constexpr double kTravelMargin_s = 3;
constexpr RigTime kPoll = std::chrono::milliseconds(20);
constexpr RigTime kKeepAlivePeriod = std::chrono::seconds(60);

// What the tacho read when the rotation was 0. (Any two counts: it may be out of their range.)
int64_t ZeroOf(const OutputState& output) {
  return int64_t{output.tacho_deg} - int64_t{output.rotation_deg};
}

// Of one rig thread. Borrows clock, port and flag.
class NxtLaser final : public LineLaser {
 public:
  NxtLaser(RigClock& clock, UsbPort& port, const StopFlag& stop, const Laser& laser)
      : clock_(clock), stop_(stop), laser_(laser), brick_(clock, port) {}
  const std::string& name() const override { return laser_.name; }
  Status Open() override;
  Status MarkZero() override;
  Status Prepare(double tilt_rad, double rate_rad_s) override;
  StatusOr<double> StartSweep(double rate_rad_s) override;
  Status AwaitTilt(double tilt_rad, RigTime deadline) override;
  StatusOr<LaserReading> Read() override;
  Status Stop() override { return Named(brick_.Halt(laser_.motor_port)); }
  Status KeepAlive() override;

 private:
  Status Named(const Status& status) const {
    return Annotate(status, fmt::format("laser {}", laser_.name));
  }
  double MotorDeg(double tilt_rad) const { return DegFromRad(tilt_rad * laser_.gear_ratio); }
  // The largest power whose speed is not above this rate; 0 is an error.
  StatusOr<int> PowerFor(double rate_rad_s) const;
  double RateOf(int power) const {
    return power / 100.0 * laser_.full_speed_rad_s / laser_.gear_ratio;
  }
  // Motor from rest to this position, at rest.
  Status Travel(double motor_deg, int power);
  // Until the motor stands, not driven any more. DeadlineExceeded names the position on the way.
  Status AwaitRest(RigTime deadline, double motor_deg);
  Status Pause();  // one poll
  // The motor, as long as its zero is where it was marked: Unavailable once the brick was off.
  StatusOr<OutputState> GetOutput();

  RigClock& clock_;
  const StopFlag& stop_;
  const Laser laser_;
  NxtBrick brick_;
  double sweep_sign_ = 1;
  // Tacho less rotation at MarkZero: the brick keeps it as long as it is on.
  std::optional<int64_t> zero_tacho_deg_;
  RigTime keep_alive_due_{};
};

Status NxtLaser::Open() {
  MESORIG_RETURN_IF_ERROR(Stop());
  const auto versions = brick_.ReadVersions();
  if (!versions.ok()) return Named(versions.status());
  if (versions->protocol_major != kProtocol) {
    return Unavailable("laser {}: the brick speaks protocol {}.{} (firmware {}.{:02}), {} is spoken here",
                       laser_.name, versions->protocol_major, versions->protocol_minor,
                       versions->firmware_major, versions->firmware_minor, kProtocol);
  }
  const auto volts = brick_.BatteryVolts();
  if (!volts.ok()) return Named(volts.status());
  if (!(*volts >= kMinBattery_v)) {
    return Unavailable("laser {}: the brick's battery has {:.2f} V, at least {} V are needed",
                       laser_.name, *volts, kMinBattery_v);
  }
  keep_alive_due_ = {};
  return KeepAlive();
}

Status NxtLaser::MarkZero() {
  zero_tacho_deg_.reset();
  MESORIG_RETURN_IF_ERROR(Named(brick_.ResetPosition(laser_.motor_port)));
  MESORIG_ASSIGN_OR_RETURN(const OutputState output, GetOutput());
  zero_tacho_deg_ = ZeroOf(output);
  return OkStatus();
}

StatusOr<OutputState> NxtLaser::GetOutput() {
  const auto output = brick_.GetOutput(laser_.motor_port);
  if (!output.ok()) return Named(output.status());
  if (zero_tacho_deg_ && ZeroOf(*output) != *zero_tacho_deg_) {
    return Unavailable("laser {}: its zero is lost, the brick was off since it was marked",
                       laser_.name);
  }
  return *output;
}

Status NxtLaser::KeepAlive() {
  if (clock_.Now() < keep_alive_due_) return OkStatus();
  const auto limit_s = brick_.KeepAlive();
  if (!limit_s.ok()) return Named(limit_s.status());
  const RigTime third = *limit_s > 0 ? FromSeconds(*limit_s / 3) : kKeepAlivePeriod;
  keep_alive_due_ = clock_.Now() + std::min(kKeepAlivePeriod, third);
  return OkStatus();
}

StatusOr<int> NxtLaser::PowerFor(double rate_rad_s) const {
  const double power =
      std::floor(std::abs(rate_rad_s) * laser_.gear_ratio / laser_.full_speed_rad_s * 100 + 1e-9);
  if (!(power >= 1 && power <= 100)) {  // (also NaN)
    return InvalidArgument(
        "laser {}: a sweep at {:.4f} deg/s; the motor does {:.4f} to {:.4f} deg/s", laser_.name,
        DegFromRad(rate_rad_s), DegFromRad(RateOf(1)), DegFromRad(RateOf(100)));
  }
  return std::copysign(1.0, rate_rad_s) > 0 ? static_cast<int>(power) : -static_cast<int>(power);
}

Status NxtLaser::Prepare(double tilt_rad, double rate_rad_s) {
  MESORIG_RETURN_IF_ERROR(KeepAlive());
  if (!(std::abs(tilt_rad) <= laser_.max_tilt_rad)) {
    return InvalidArgument("laser {}: a tilt of {:.3f} deg, permitted is {:.3f} to both sides",
                           laser_.name, DegFromRad(tilt_rad), DegFromRad(laser_.max_tilt_rad));
  }
  MESORIG_ASSIGN_OR_RETURN(const int power, PowerFor(rate_rad_s));
  const double run_up_deg = DegFromRad(laser_.backlash_rad) + 2 * kPositionTolerance_deg +
                            kRunUp_s * DegFromRad(laser_.full_speed_rad_s) * std::abs(power) / 100;
  const double start_deg = MotorDeg(tilt_rad) - std::copysign(run_up_deg, rate_rad_s);
  // The same sweep begins at the same place whatever was before it: the way is measured with the
  // motor at rest, and where braking ends is that of the last leg.
  MESORIG_RETURN_IF_ERROR(Named(brick_.Brake(laser_.motor_port)));
  MESORIG_RETURN_IF_ERROR(AwaitRest(clock_.Now() + FromSeconds(kBraking_s), start_deg));
  MESORIG_RETURN_IF_ERROR(
      Travel(start_deg - std::copysign(kApproach_deg, rate_rad_s), kTravelPower));
  return Travel(start_deg, kApproachPower);
}

Status NxtLaser::Travel(double motor_deg, int power) {
  double residual = 0;
  for (int attempt = 0; attempt <= kTravelAttempts; ++attempt) {
    MESORIG_ASSIGN_OR_RETURN(const OutputState output, GetOutput());
    residual = motor_deg - output.rotation_deg;
    if (std::abs(residual) <= kPositionTolerance_deg) return OkStatus();
    if (attempt == kTravelAttempts) break;
    const auto distance = static_cast<uint32_t>(std::abs(std::round(residual)));
    MESORIG_RETURN_IF_ERROR(
        Named(brick_.Run(laser_.motor_port, residual > 0 ? power : -power, distance)));
    const double seconds =
        distance / (DegFromRad(laser_.full_speed_rad_s) * power / 100) + kTravelMargin_s;
    MESORIG_RETURN_IF_ERROR(AwaitRest(clock_.Now() + FromSeconds(seconds), motor_deg));
  }
  return Unavailable("laser {}: the motor stands {:.0f} deg from {:.0f} deg after {} moves",
                     laser_.name, residual, motor_deg, kTravelAttempts);
}

Status NxtLaser::Pause() {
  const Status waited = stop_.Wait(clock_.Now() + kPoll, [] { return false; });
  return absl::IsCancelled(waited) ? waited : OkStatus();
}

Status NxtLaser::AwaitRest(RigTime deadline, double motor_deg) {
  int32_t last = 0;
  for (int same = 0;;) {
    MESORIG_RETURN_IF_ERROR(Pause());
    MESORIG_ASSIGN_OR_RETURN(const OutputState output, GetOutput());
    const bool driven = output.running && output.power != 0;  // braked, it counts as running
    same = driven ? 0 : same > 0 && output.rotation_deg == last ? same + 1 : 1;
    if (same == kStandingReadings) return OkStatus();
    last = output.rotation_deg;
    if (clock_.Now() >= deadline) {
      (void)Stop();
      return DeadlineExceeded("laser {}: the motor is at {} deg and still on its way to {:.0f}",
                              laser_.name, last, motor_deg);
    }
  }
}

StatusOr<double> NxtLaser::StartSweep(double rate_rad_s) {
  MESORIG_ASSIGN_OR_RETURN(const int power, PowerFor(rate_rad_s));
  sweep_sign_ = power > 0 ? 1 : -1;
  MESORIG_RETURN_IF_ERROR(Named(brick_.Run(laser_.motor_port, power, 0)));
  return RateOf(power);
}

Status NxtLaser::AwaitTilt(double tilt_rad, RigTime deadline) {
  for (;;) {
    MESORIG_ASSIGN_OR_RETURN(const LaserReading reading, Read());
    if (sweep_sign_ * (reading.tilt_rad - tilt_rad) >= 0) return OkStatus();
    if (clock_.Now() >= deadline) {
      return DeadlineExceeded("laser {}: tilt {:.3f} deg, {:.3f} deg wanted by now", laser_.name,
                              DegFromRad(reading.tilt_rad), DegFromRad(tilt_rad));
    }
    MESORIG_RETURN_IF_ERROR(Pause());
  }
}

StatusOr<LaserReading> NxtLaser::Read() {
  MESORIG_ASSIGN_OR_RETURN(const OutputState output, GetOutput());
  return LaserReading{RadFromDeg(output.rotation_deg) / laser_.gear_ratio, output.running,
                      clock_.Now()};
}

}  // namespace

Driver Describe() {
  Driver driver;
  driver.make_laser = [](const DriverContext& context) -> StatusOr<std::unique_ptr<LineLaser>> {
    if (!context.rig->laser) return FailedPrecondition("the rig has no laser");
    const Laser& laser = *context.rig->laser;
    if (context.usb == nullptr) {
      return FailedPrecondition(
          "laser {}: driver nxt_laser needs the brick's USB port, and there is none", laser.name);
    }
    return std::make_unique<NxtLaser>(*context.clock, *context.usb, *context.stop, laser);
  };
  return driver;
}

}  // namespace mesorig::daemon::nxt_laser
