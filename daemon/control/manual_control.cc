#include "daemon/control/manual_control.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <optional>
#include <utility>

#include "daemon/device/rig_thread.h"
#include "protocol/base/check.h"
#include "protocol/base/log.h"
#include "protocol/base/mutex.h"
#include "protocol/plan/plan.h"

namespace mesorig::daemon {
namespace {

constexpr RigTime kLook{50'000'000};  // how often a motion is looked at
constexpr double kMoveMargin_s = 5, kHomeMargin_s = 30;
constexpr RigTime kFailureTold{1'000'000'000};  // a jog's failure is told for so long
constexpr size_t kOrdersWaiting = 16;

enum class Kind { kJog, kMove, kHome, kLamp, kLaser };

struct Order {
  Kind kind{};
  uint64_t token = 0, stops = 0;
  int index = -1;    // axis or lamp
  double value = 0;  // rad, rad/s, s
  std::shared_ptr<std::promise<Status>> done = std::make_shared<std::promise<Status>>();
};

class ManualControlImpl final : public ManualControl {
 public:
  ManualControlImpl(RigClock& clock, const Rig& rig, ManualDevices devices)
      : clock_(clock),
        rig_(rig),
        devices_(std::move(devices)),
        touched_(devices_.axes.size()),
        axis_read_(devices_.axes.size()),
        axis_commanded_(devices_.axes.size()),
        thread_(clock, "manual control", [this] { Loop(); }) {}
  ~ManualControlImpl() override {
    clock_.Change([&] { ending_ = true; });
  }

  void Admit(uint64_t token) override;
  void Close(uint64_t newest, std::string_view why) override;
  Status AwaitRest(double host_s) override;
  void Stop(std::string_view reason) override;
  Status Jog(uint64_t token, int axis, double rate_rad_s) override;
  std::future<Status> MoveTo(uint64_t token, int axis, double target_rad) override;
  std::future<Status> Home(uint64_t token, int axis) override;
  std::future<Status> SetLamp(uint64_t token, int lamp) override;
  std::future<Status> TestLaser(uint64_t token, double seconds) override;
  ManualStatus GetStatus() const override;
  void OnNote(std::function<void(const std::string&)> listener) override {
    const MutexLock lock(listener_mutex_);
    listener_ = std::move(listener);
  }

 private:
  struct JogHold {
    int axis = -1;
    double rate_rad_s = 0;
    RigTime until{};
  };

  // Under the clock's lock.
  Status CheckTokenInsideChange(uint64_t token) const;
  Status CheckOrderInsideChange(const Order& order) const;
  void EndAllInsideChange(std::string_view why);
  std::future<Status> Give(Order order, Status valid);
  Status CheckAxis(int axis) const;

  // Of the manual thread.
  void Loop();
  Status Serve(const Order& order);
  void SetDoing(std::string doing);
  void Tell(const std::string& note);
  // Just before each command to a device: the order is still to be carried out.
  Status Admitted(const Order& order);
  Status PowerUp(const Order& order);
  Status RunMove(const Order& order);
  Status RunHome(const Order& order);
  Status RunJog(const Order& order);
  Status StartJog(const Order& order, double rate_rad_s);
  Status SwitchLamp(const Order& order);
  Status ShineLaser(const Order& order);
  Status AwaitSlices(const std::function<Status(RigTime)>& await, RigTime deadline);
  void StopAxis(int axis);
  void NoteAxis(int axis);
  void NoteCommanded(std::optional<Reading>& slot, Reading reading);
  void MakeSafe();

  RigClock& clock_;
  const Rig& rig_;
  const ManualDevices devices_;
  std::vector<bool> touched_;  // axes that got torque; of the manual thread

  // Guarded by the clock's lock:
  bool open_ = false, off_wanted_ = false, at_rest_ = true, ending_ = false;
  uint64_t newest_ = 0, stops_ = 0;
  std::deque<Order> orders_;
  std::string doing_;
  JogHold jog_;
  Status jog_failure_;  // of the last jog, for its next call
  RigTime jog_failed_at_{};
  std::vector<std::optional<Reading>> axis_read_, axis_commanded_;
  std::optional<Reading> lamp_commanded_, laser_commanded_;

  mutable Mutex rest_mutex_;
  CondVar rested_;
  mutable Mutex listener_mutex_;
  std::function<void(const std::string&)> listener_ GUARDED_BY(listener_mutex_);
  RigThread thread_;
};

// The fence.

void ManualControlImpl::Admit(uint64_t token) {
  clock_.Change([&] {
    MESORIG_CHECK(token > newest_);
    EndAllInsideChange("a newer lease is in force");
    newest_ = token;
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
  clock_.Change([&] {
    ++stops_;
    EndAllInsideChange(reason);
  });
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

Status ManualControlImpl::CheckOrderInsideChange(const Order& order) const {
  MESORIG_RETURN_IF_ERROR(CheckTokenInsideChange(order.token));
  if (order.stops != stops_) return Cancelled("stopped since it was ordered");
  return OkStatus();
}

// Orders.

Status ManualControlImpl::CheckAxis(int axis) const {
  if (axis >= 0 && axis < static_cast<int>(devices_.axes.size())) return OkStatus();
  return InvalidArgument("axis {} is not in [0, {}]", axis,
                         static_cast<int>(devices_.axes.size()) - 1);
}

std::future<Status> ManualControlImpl::Give(Order order, Status valid) {
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
    if (begins) orders_.push_back({Kind::kJog, token, stops_, axis, rate_rad_s});
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
  return Give({Kind::kMove, token, 0, axis, target_rad}, std::move(valid));
}

std::future<Status> ManualControlImpl::Home(uint64_t token, int axis) {
  return Give({Kind::kHome, token, 0, axis}, CheckAxis(axis));
}

std::future<Status> ManualControlImpl::SetLamp(uint64_t token, int lamp) {
  const int lamps = static_cast<int>(rig_.lamps.size());
  return Give({Kind::kLamp, token, 0, lamp},
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
  return Give({Kind::kLaser, token, 0, -1, seconds}, std::move(valid));
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

// The thread.

void ManualControlImpl::Loop() {
  std::optional<RigClock::Activity> activity;
  for (;;) {
    bool off = false, open = false, ending = false;
    std::optional<Order> order;
    clock_.WaitUntil(kNever, [&] {
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
        if (order->kind == Kind::kJog) {
          jog_ = {};
          jog_failure_ = absl::IsCancelled(done) ? OkStatus() : done;
          jog_failed_at_ = ended;
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
  std::deque<Order> left;
  clock_.Change([&] { left.swap(orders_); });
  for (const Order& order : left) order.done->set_value(Cancelled("the daemon ends"));
}

Status ManualControlImpl::Admitted(const Order& order) {
  Status status;
  clock_.Change([&] {
    status = CheckOrderInsideChange(order);
    if (status.ok() && off_wanted_) status = Cancelled("everything is going off");
    // What raised the flag before this order was given is over.
    if (status.ok()) devices_.stop->LowerInsideChange();
  });
  return status;
}

Status ManualControlImpl::Serve(const Order& order) {
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  Status done;
  switch (order.kind) {
    case Kind::kJog:
      done = RunJog(order);
      break;
    case Kind::kMove:
      done = RunMove(order);
      break;
    case Kind::kHome:
      done = RunHome(order);
      break;
    case Kind::kLamp:
      done = SwitchLamp(order);
      break;
    case Kind::kLaser:
      done = ShineLaser(order);
      break;
  }
  if (!done.ok() && order.kind != Kind::kLamp && order.kind != Kind::kLaser) StopAxis(order.index);
  if (!done.ok()) Tell(fmt::format("by hand: {}", Message(done)));
  return done;
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

Status ManualControlImpl::PowerUp(const Order& order) {
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

Status ManualControlImpl::RunMove(const Order& order) {
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

Status ManualControlImpl::RunHome(const Order& order) {
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
Status ManualControlImpl::StartJog(const Order& order, double rate_rad_s) {
  Axis& axis = *devices_.axes[order.index];
  const mesorig::Axis& description = rig_.axes[order.index];
  SetDoing(fmt::format("{} jogs at {:.4g} deg/s", description.name, DegFromRad(rate_rad_s)));
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  MESORIG_RETURN_IF_ERROR(axis.SetSpeed(std::abs(rate_rad_s)));
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  NoteCommanded(axis_commanded_[order.index], {description.name + " rate", "rad/s", rate_rad_s});
  return axis.StartMove(rate_rad_s > 0 ? description.max_rad : description.min_rad);
}

Status ManualControlImpl::RunJog(const Order& order) {
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

Status ManualControlImpl::SwitchLamp(const Order& order) {
  const bool on = order.index >= 0;
  if (on) MESORIG_RETURN_IF_ERROR(devices_.may_energise());
  MESORIG_RETURN_IF_ERROR(Admitted(order));
  NoteCommanded(lamp_commanded_, {on ? rig_.lamps[order.index].name : "lamps", "1", on ? 1.0 : 0});
  return devices_.lamps->SwitchTo(on ? rig_.lamps[order.index].channel : -1);
}

Status ManualControlImpl::ShineLaser(const Order& order) {
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
  std::deque<Order> dropped;
  clock_.Change([&] {  // (what a newer lease ordered stays)
    const auto kept = std::stable_partition(
        orders_.begin(), orders_.end(),
        [&](const Order& order) { return CheckOrderInsideChange(order).ok(); });
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
  for (const Order& order : dropped) order.done->set_value(Cancelled("everything went off"));
}

}  // namespace

std::unique_ptr<ManualControl> ManualControl::Create(RigClock& clock, const Rig& rig,
                                                     ManualDevices devices) {
  MESORIG_CHECK(devices.stop != nullptr && devices.lamps != nullptr && devices.may_energise);
  MESORIG_CHECK(devices.axes.size() == rig.axes.size());
  return std::make_unique<ManualControlImpl>(clock, rig, std::move(devices));
}

}  // namespace mesorig::daemon
