#include <algorithm>
#include <cmath>

#include "daemon/control/manual_thread.h"
#include "protocol/base/log.h"
#include "protocol/plan/plan.h"

namespace mesorig::daemon {
namespace {

constexpr RigTime kLook{50'000'000};  // how often a motion is looked at
constexpr RigTime kIdleLook{1'000'000'000};  // how often who has left something on says "alive"
constexpr double kMoveMargin_s = 5, kHomeMargin_s = 30;

}  // namespace

// The thread.

void ManualControlImpl::Loop() {
  std::optional<RigClock::Activity> activity;
  for (;;) {
    bool off = false, open = false, ending = false;
    std::optional<ManualOrder> order;
    // What was left on (a lamp, torque) has somebody who answers for it.
    const bool on = LeftOn();
    if (on) devices_.alive();
    clock_.WaitUntil(on ? clock_.Now() + kIdleLook : kNever, [&] {
      return ending_ || off_wanted_ || !orders_.empty() || open_ != activity.has_value();
    });
    clock_.Change([&] {
      ending = ending_;
      if (ending) open_ = false;
      open = open_;
      off = std::exchange(off_wanted_, false) || ending;
      if (off || orders_.empty()) return;
      order = std::move(orders_.front());
      orders_.pop_front();
    });
    // (Whatever comes to rest needs time.)
    if (open && !activity) activity.emplace(clock_, Pace::kRealTime);
    if (off) MakeSafe();
    if (order) {
      const Status done = Serve(*order);
      const RigTime ended = clock_.Now();
      clock_.Change([&] {
        doing_.clear();
        if (order->kind == ManualKind::kJog) {
          jog_ = {};
          // (What ended by a stop has been told.)
          if (!done.ok() && !absl::IsCancelled(done) && order->token == newest_) {
            jog_failure_ = done;
            jog_failed_at_ = ended;
          }
        }
      });
      order->done->set_value(done);
    }
    bool rest = false;
    clock_.Change([&] { rest = at_rest_ = !open_ && !off_wanted_; });
    if (rest || ending) {
      activity.reset();
      const MutexLock lock(rest_mutex_);
      rested_.NotifyAll();
    }
    if (ending) break;
  }
  std::deque<ManualOrder> left;
  clock_.Change([&] { left.swap(orders_); });
  for (const ManualOrder& order : left) order.done->set_value(Cancelled("the daemon ends"));
}

Status ManualControlImpl::Admitted(const ManualOrder& order) {
  Status status;
  clock_.Change([&] {
    status = CheckOrderInsideChange(order);
    if (status.ok() && off_wanted_) status = Cancelled("everything is going off");
    // What raised the flag before this order was given is over.
    if (status.ok()) devices_.stop->LowerInsideChange();
  });
  return status;
}

Status ManualControlImpl::Serve(const ManualOrder& order) {
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  Status done;
  switch (order.kind) {
    case ManualKind::kJog:
      done = RunJog(order);
      break;
    case ManualKind::kMove:
      done = RunMove(order);
      break;
    case ManualKind::kHome:
      done = RunHome(order);
      break;
    case ManualKind::kLamp:
      done = SwitchLamp(order);
      break;
    case ManualKind::kLaser:
      done = ShineLaser(order);
      break;
  }
  if (!done.ok() && order.kind != ManualKind::kLamp && order.kind != ManualKind::kLaser)
    StopAxis(order.index);
  if (!done.ok()) Tell(fmt::format("by hand: {}", Message(done)));
  return done;
}

bool ManualControlImpl::LeftOn() const {
  bool lit = false;
  clock_.Read([&] { lit = open_ && LitInsideChange(); });
  return lit || std::find(touched_.begin(), touched_.end(), true) != touched_.end();
}

void ManualControlImpl::SetDoing(std::string doing) {
  clock_.Change([&] { doing_ = std::move(doing); });
}

void ManualControlImpl::Tell(const std::string& note) {
  Log("control").info("{}", note);
  std::function<void(const std::string&)> listener;
  {
    const MutexLock lock(listener_mutex_);
    listener = listener_;
  }
  if (listener) listener(note);
}

void ManualControlImpl::NoteAxis(int axis) {
  const AxisReading read = devices_.axes[axis]->Read();
  Reading reading{rig_.axes[axis].name, "rad", read.position_rad, read.read_at};
  clock_.Change([&] { axis_read_[axis] = std::move(reading); });
}

void ManualControlImpl::NoteCommanded(std::optional<Reading>& slot, Reading reading) {
  reading.source = ReadingSource::kCommanded;
  reading.read_at = clock_.Now();
  clock_.Change([&] { slot = std::move(reading); });
}

Status ManualControlImpl::PowerUp(const ManualOrder& order) {
  MESORIG_RETURN_IF_ERROR(devices_.may_energise());
  Axis& axis = *devices_.axes[order.index];
  if (axis.Read().enabled) return OkStatus();
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  touched_[order.index] = true;
  return axis.Enable();
}

// Waits in slices, so that a motion is seen to go on.
Status ManualControlImpl::AwaitSlices(const std::function<Status(RigTime)>& await,
                                      RigTime deadline) {
  for (;;) {
    devices_.alive();
    const RigTime slice = std::min(deadline, clock_.Now() + kLook);
    const Status status = await(slice);
    if (!absl::IsDeadlineExceeded(status) || clock_.Now() >= deadline) return status;
  }
}

Status ManualControlImpl::RunMove(const ManualOrder& order) {
  Axis& axis = *devices_.axes[order.index];
  const mesorig::Axis& description = rig_.axes[order.index];
  if (!axis.Read().referenced) {
    return FailedPrecondition("{}: not referenced: home it first", description.name);
  }
  MESORIG_RETURN_IF_ERROR(PowerUp(order));
  SetDoing(fmt::format("{} moves to {:.4f} deg", description.name, DegFromRad(order.value)));
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  MESORIG_RETURN_IF_ERROR(axis.SetSpeed(description.max_velocity_rad_s));
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  NoteCommanded(axis_commanded_[order.index], {description.name, "rad", order.value});
  const double distance = order.value - axis.Read().position_rad;
  MESORIG_RETURN_IF_ERROR(axis.StartMove(order.value));
  return AwaitSlices(
      [&](RigTime slice) {
        const Status status = axis.AwaitMove(slice);
        NoteAxis(order.index);
        return status;
      },
      clock_.Now() + FromSeconds(MoveSeconds(description, distance) + kMoveMargin_s));
}

Status ManualControlImpl::RunHome(const ManualOrder& order) {
  Axis& axis = *devices_.axes[order.index];
  const mesorig::Axis& description = rig_.axes[order.index];
  MESORIG_RETURN_IF_ERROR(PowerUp(order));
  SetDoing(fmt::format("{} homes", description.name));
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  NoteCommanded(axis_commanded_[order.index], {description.name, "rad", 0});
  MESORIG_RETURN_IF_ERROR(axis.StartHoming());
  // At worst over the whole range and back.
  const double span_s =
      2 * (description.max_rad - description.min_rad) / description.homing_velocity_rad_s;
  return AwaitSlices(
      [&](RigTime slice) {
        const Status status = axis.AwaitHoming(slice);
        NoteAxis(order.index);
        return status;
      },
      clock_.Now() + FromSeconds(span_s + kHomeMargin_s));
}

// Towards the soft limit, where it ends by itself.
Status ManualControlImpl::StartJog(const ManualOrder& order, double rate_rad_s) {
  Axis& axis = *devices_.axes[order.index];
  const mesorig::Axis& description = rig_.axes[order.index];
  SetDoing(fmt::format("{} jogs at {:.4g} deg/s", description.name, DegFromRad(rate_rad_s)));
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  MESORIG_RETURN_IF_ERROR(axis.SetSpeed(std::abs(rate_rad_s)));
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  NoteCommanded(axis_commanded_[order.index], {description.name + " rate", "rad/s", rate_rad_s});
  return axis.StartMove(rate_rad_s > 0 ? description.max_rad : description.min_rad);
}

Status ManualControlImpl::RunJog(const ManualOrder& order) {
  Axis& axis = *devices_.axes[order.index];
  if (!axis.Read().referenced) {
    return FailedPrecondition("{}: not referenced, so that its limits are not known: home it first",
                              rig_.axes[order.index].name);
  }
  MESORIG_RETURN_IF_ERROR(PowerUp(order));
  double rate = 0;
  for (;;) {
    JogHold hold;
    clock_.Read([&] { hold = jog_; });
    const RigTime now = clock_.Now();
    if (hold.axis != order.index || now >= hold.until) break;  // let go, or nobody holds it
    if (hold.rate_rad_s != rate) {
      rate = hold.rate_rad_s;
      MESORIG_RETURN_IF_ERROR(StartJog(order, rate));
    }
    devices_.alive();
    const Status waited = devices_.stop->Wait(std::min(hold.until, now + kLook), [&] {
      return jog_.axis != order.index || jog_.rate_rad_s != rate;
    });
    if (absl::IsCancelled(waited)) return waited;
    NoteAxis(order.index);
    const AxisReading reading = axis.Read();
    // Where it stands is the limit, or what AwaitMove says.
    if (!reading.moving || !reading.enabled) {
      MESORIG_RETURN_IF_ERROR(axis.AwaitMove(clock_.Now() + kLook));
      break;
    }
  }
  StopAxis(order.index);
  return OkStatus();
}

Status ManualControlImpl::SwitchLamp(const ManualOrder& order) {
  const bool on = order.index >= 0;
  if (on) MESORIG_RETURN_IF_ERROR(devices_.may_energise());
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  NoteCommanded(lamp_commanded_, {on ? rig_.lamps[order.index].name : "lamps", "1", on ? 1.0 : 0});
  return devices_.lamps->SwitchTo(on ? rig_.lamps[order.index].channel : -1);
}

Status ManualControlImpl::ShineLaser(const ManualOrder& order) {
  MESORIG_RETURN_IF_ERROR(devices_.may_energise());
  SetDoing(fmt::format("{} shines for {} s", rig_.laser ? rig_.laser->name : "laser", order.value));
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  NoteCommanded(laser_commanded_, {"laser", "1", 1});
  Status status = devices_.gate->Open();
  const RigTime end = clock_.Now() + FromSeconds(order.value);
  while (status.ok() && clock_.Now() < end) {
    devices_.gate->Progress();
    devices_.alive();
    status = devices_.stop->Wait(std::min(end, clock_.Now() + kLook), [] { return false; });
    if (absl::IsDeadlineExceeded(status)) status = OkStatus();
  }
  devices_.gate->Shut();
  NoteCommanded(laser_commanded_, {"laser", "1", 0});
  if (status.ok()) status = devices_.gate->Close();
  return status;
}

// Does not look at the StopFlag. Torque off as well: the next motion switches it on.
void ManualControlImpl::StopAxis(int index) {
  Axis& axis = *devices_.axes[index];
  for (const Status& status : {axis.QuickStop(), axis.Disable()}) {
    if (!status.ok()) Tell(fmt::format("by hand: {}: {}", axis.name(), Message(status)));
  }
  NoteAxis(index);
}

void ManualControlImpl::MakeSafe() {
  std::deque<ManualOrder> dropped;
  std::string stopped;
  clock_.Change([&] {  // (what a newer lease ordered stays)
    if (std::exchange(stop_untold_, false)) stopped = stopped_why_;
    const auto kept = std::stable_partition(
        orders_.begin(), orders_.end(),
        [&](const ManualOrder& order) { return CheckOrderInsideChange(order).ok(); });
    dropped.assign(kept, orders_.end());
    orders_.erase(kept, orders_.end());
  });
  if (devices_.gate != nullptr) devices_.gate->Shut();
  if (const Status off = devices_.lamps->AllOff(); !off.ok()) {
    Tell(fmt::format("by hand: lamps off: {}", Message(off)));
  }
  // All of them first: one that does not answer must not delay the next one's stop.
  for (size_t i = 0; i < touched_.size(); ++i) {
    if (touched_[i]) (void)devices_.axes[i]->QuickStop();
  }
  for (size_t i = 0; i < touched_.size(); ++i) {
    if (touched_[i]) StopAxis(static_cast<int>(i));
    touched_[i] = false;
  }
  clock_.Change([&] {
    for (auto& slot : axis_commanded_) slot.reset();
    lamp_commanded_.reset();
    laser_commanded_.reset();
  });
  for (const ManualOrder& order : dropped) {
    order.done->set_value(Cancelled("{}", stopped.empty() ? "everything went off" : stopped));
  }
  if (!stopped.empty()) Tell(fmt::format("by hand: everything is off: {}", stopped));
}

}  // namespace mesorig::daemon
