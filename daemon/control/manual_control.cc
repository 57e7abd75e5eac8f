#include <chrono>
#include <cmath>

#include "daemon/control/manual_thread.h"
#include "protocol/base/check.h"

namespace mesorig::daemon {
namespace {

constexpr RigTime kFailureTold{1'000'000'000};  // a jog's failure is told for so long
constexpr size_t kOrdersWaiting = 16;

}  // namespace

// The fence.

void ManualControlImpl::Admit(uint64_t token) {
  clock_.Change([&] {
    MESORIG_CHECK(token > newest_);
    EndAllInsideChange("a newer lease is in force");
    newest_ = token;
    jog_failure_ = OkStatus();
    open_ = true;
    at_rest_ = false;
  });
}

void ManualControlImpl::Close(uint64_t newest, std::string_view why) {
  clock_.Change([&] {
    newest_ = std::max(newest_, newest);
    EndAllInsideChange(why);
    open_ = false;
  });
}

void ManualControlImpl::Stop(std::string_view reason) {
  const RigTime now = clock_.Now();
  clock_.Change([&] {
    ++stops_;
    stopped_why_ = reason;
    stop_untold_ |= WorksInsideChange();
    const bool jogs = jog_.axis >= 0;
    EndAllInsideChange(reason);
    if (!jogs) return;
    jog_failure_ = Cancelled("{}", reason);
    jog_failed_at_ = now;
  });
}

bool ManualControlImpl::WorksInsideChange() const {
  return open_ &&
         (LitInsideChange() || !doing_.empty() || !orders_.empty() || jog_.axis >= 0);
}

// What is under way ends within one wait; what it left on goes off before the next order.
void ManualControlImpl::EndAllInsideChange(std::string_view why) {
  if (!open_) return;
  devices_.stop->RaiseInsideChange(why);
  jog_ = {};
  jog_failure_ = OkStatus();
  off_wanted_ = true;
}

Status ManualControlImpl::AwaitRest(double host_s) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(host_s);
  const MutexLock lock(rest_mutex_);
  for (;;) {
    bool rest = false;
    clock_.Read([&] { rest = at_rest_; });
    if (rest) return OkStatus();
    const auto left = deadline - std::chrono::steady_clock::now();
    if (left <= left.zero()) {
      return Unavailable("manual control: the rig is not at rest after {} s", host_s);
    }
    rested_.WaitFor(rest_mutex_, std::chrono::duration_cast<std::chrono::nanoseconds>(left));
  }
}

Status ManualControlImpl::CheckTokenInsideChange(uint64_t token) const {
  if (open_ && token == newest_ && !ending_) return OkStatus();
  return FailedPrecondition("lease {} is over: nothing is commanded for it any more (newest: {}{})",
                            token, newest_, open_ ? "" : ", over as well");
}

Status ManualControlImpl::CheckOrderInsideChange(const ManualOrder& order) const {
  MESORIG_RETURN_IF_ERROR(CheckTokenInsideChange(order.token));
  if (order.stops != stops_) return Cancelled("{}, after this was ordered", stopped_why_);
  return OkStatus();
}

// Orders.

Status ManualControlImpl::CheckAxis(int axis) const {
  if (axis >= 0 && axis < static_cast<int>(devices_.axes.size())) return OkStatus();
  return InvalidArgument("axis {} is not in [0, {}]", axis,
                         static_cast<int>(devices_.axes.size()) - 1);
}

std::future<Status> ManualControlImpl::Give(ManualOrder order, Status valid) {
  std::future<Status> done = order.done->get_future();
  if (valid.ok()) {
    clock_.Change([&] {
      valid = CheckTokenInsideChange(order.token);
      if (valid.ok() && jog_.axis >= 0) {
        valid = FailedPrecondition("axis {} is being jogged", rig_.axes[jog_.axis].name);
      }
      if (valid.ok() && orders_.size() >= kOrdersWaiting) {
        valid = FailedPrecondition("{} orders are waiting already", orders_.size());
      }
      order.stops = stops_;
      if (valid.ok()) orders_.push_back(order);
    });
  }
  if (!valid.ok()) order.done->set_value(valid);
  return done;
}

Status ManualControlImpl::Jog(uint64_t token, int axis, double rate_rad_s) {
  MESORIG_RETURN_IF_ERROR(CheckAxis(axis));
  const mesorig::Axis& description = rig_.axes[axis];
  const double fastest = description.max_velocity_rad_s;
  if (!(std::abs(rate_rad_s) <= fastest)) {
    return InvalidArgument("{}: {} deg/s is not in [{:.4g}, {:.4g}] deg/s", description.name,
                           DegFromRad(rate_rad_s), -DegFromRad(fastest), DegFromRad(fastest));
  }
  Status status;
  const RigTime now = clock_.Now();
  clock_.Change([&] {
    status = CheckTokenInsideChange(token);
    if (!status.ok()) return;
    status = std::exchange(jog_failure_, OkStatus());
    if (!status.ok() && now < jog_failed_at_ + kFailureTold) return;
    status = OkStatus();
    if (rate_rad_s == 0) {
      if (jog_.axis == axis) jog_ = {};
      return;
    }
    const bool begins = jog_.axis < 0;
    if (!begins && jog_.axis != axis) {
      status = FailedPrecondition("axis {} is being jogged", rig_.axes[jog_.axis].name);
    } else if (begins && (!orders_.empty() || !doing_.empty())) {
      status = FailedPrecondition("{}", doing_.empty() ? "another order is waiting" : doing_);
    }
    if (!status.ok()) return;
    jog_ = {axis, rate_rad_s, now + FromSeconds(kHold_s)};
    if (begins) orders_.push_back({ManualKind::kJog, token, stops_, axis, rate_rad_s});
  });
  return status;
}

std::future<Status> ManualControlImpl::MoveTo(uint64_t token, int axis, double target_rad) {
  Status valid = CheckAxis(axis);
  if (valid.ok()) {
    const mesorig::Axis& description = rig_.axes[axis];
    if (!(target_rad >= description.min_rad && target_rad <= description.max_rad)) {
      valid = InvalidArgument("{}: target {:.4f} deg is not in [{:.4f}, {:.4f}] deg",
                              description.name, DegFromRad(target_rad),
                              DegFromRad(description.min_rad), DegFromRad(description.max_rad));
    }
  }
  return Give({ManualKind::kMove, token, 0, axis, target_rad}, std::move(valid));
}

std::future<Status> ManualControlImpl::Home(uint64_t token, int axis) {
  return Give({ManualKind::kHome, token, 0, axis}, CheckAxis(axis));
}

std::future<Status> ManualControlImpl::SetLamp(uint64_t token, int lamp) {
  const int lamps = static_cast<int>(rig_.lamps.size());
  return Give({ManualKind::kLamp, token, 0, lamp},
              lamp >= -1 && lamp < lamps
                  ? OkStatus()
                  : InvalidArgument("lamp {} is not in [-1, {}]", lamp, lamps - 1));
}

std::future<Status> ManualControlImpl::TestLaser(uint64_t token, double seconds) {
  Status valid;
  if (devices_.gate == nullptr) {
    valid = FailedPrecondition("rig {} has no laser", rig_.name);
  } else if (!(seconds > 0 && seconds <= kMaxLaser_s)) {
    valid = InvalidArgument("laser: {} s is not in (0, {}] s", seconds, kMaxLaser_s);
  }
  return Give({ManualKind::kLaser, token, 0, -1, seconds}, std::move(valid));
}

ManualStatus ManualControlImpl::GetStatus() const {
  ManualStatus status;
  clock_.Read([&] {
    status.open = open_;
    status.at_rest = at_rest_;
    status.token = newest_;
    status.doing = doing_;
    for (const auto* slots : {&axis_read_, &axis_commanded_}) {
      for (const auto& slot : *slots) {
        if (slot) status.readings.push_back(*slot);
      }
    }
    if (lamp_commanded_) status.readings.push_back(*lamp_commanded_);
    if (laser_commanded_) status.readings.push_back(*laser_commanded_);
  });
  return status;
}

std::unique_ptr<ManualControl> ManualControl::Create(RigClock& clock, const Rig& rig,
                                                     ManualDevices devices) {
  MESORIG_CHECK(devices.stop != nullptr && devices.lamps != nullptr && devices.may_energise);
  MESORIG_CHECK(devices.axes.size() == rig.axes.size());
  return std::make_unique<ManualControlImpl>(clock, rig, std::move(devices));
}

}  // namespace mesorig::daemon
