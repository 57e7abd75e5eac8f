// Motion: moves, homing, and whether the axis stands where it should.

#include "daemon/drivers/cia402/cia402_axis.h"

#include <cmath>
#include <limits>
#include <utility>

namespace mesorig::daemon::cia402 {
namespace {

constexpr double kLimitSlack_rad = 1e-9;  // limits and targets both come from degrees

}  // namespace

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

Status Cia402Axis::AwaitMove(RigTime deadline) {
  // Bit 10 fell, or was confirmed, with the acknowledge that StartMove saw.
  constexpr uint16_t kEnds = kTargetReached | kFollowingError | kInternalLimit;
  const Status waited = AwaitStatus(
      deadline, [](uint16_t word) { return (word & kEnds) != 0; }, "target reached");
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
  if ((now_seen.statusword & kInternalLimit) != 0) {
    return Unavailable("{}: the drive goes no further than its own limits (0x607D): {}", device_,
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

}  // namespace mesorig::daemon::cia402
