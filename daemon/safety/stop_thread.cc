// Safety's stop thread: on the host clock, beside everything else.

#include "daemon/safety/safety.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kLook{200};
constexpr std::chrono::seconds kStopLimit{10};  // more than the lamp bank's own limit
constexpr std::chrono::seconds kHealthLimit{15};

}  // namespace

Status Safety::StopNow(std::string_view reason) {
  auto order = std::make_shared<Order>();
  order->reason = reason;
  std::future<Status> done = order->done.get_future();
  clock_.Change([&] {
    ++seen_.stops;
    ++stopping_;  // from now on nothing is asked for
  });
  {
    const std::lock_guard lock(stop_mutex_);
    orders_.push_back(order);
    stop_wake_.notify_all();
  }
  if (done.wait_for(kStopLimit) != std::future_status::ready) {
    return DeadlineExceeded("stop: not done within {} s", kStopLimit.count());
  }
  return done.get();
}

void Safety::ServeStops() {
  std::unique_lock lock(stop_mutex_);
  for (;;) {
    stop_wake_.wait_for(lock, kLook, [&] { return stop_ending_ || !orders_.empty(); });
    if (stop_ending_ && orders_.empty()) return;
    stop_round_ = HostClock::now();
    const auto orders = std::exchange(orders_, {});
    lock.unlock();
    if (!orders.empty()) CarryOut(orders);
    LookForHang();
    lock.lock();
  }
}

void Safety::CarryOut(const std::vector<std::shared_ptr<Order>>& orders) {
  on_stop_.Tell(orders.front()->reason);
  const Status off = DeEnergise();
  clock_.Change([&] { stopping_ -= static_cast<int>(orders.size()); });
  for (const auto& order : orders) order->done.set_value(off);
}

// Counts looks instead of believing the clock: a daemon that slept is not one that hung.
void Safety::LookForHang() {
  std::string name;
  for (const RigClock::Runner& runner : clock_.Runners()) {
    if (runner.running >= kLook && (name.empty() || runner.name == runner_)) name = runner.name;
  }
  runner_looks_ = !name.empty() && name == runner_ ? runner_looks_ + 1 : 0;
  runner_ = name;
  const bool hangs = runner_looks_ * kLook >= options_.host_hang;
  bool energised = false, before = false;
  clock_.Change([&] {
    before = hangs_;
    energised = EnergisedInsideChange();
    hangs_ = hangs && (before || energised);
    if (hangs_ && !before) {
      hang_ = fmt::format("{} makes no progress for {:.1f} s while the rig is energised", name,
                          std::chrono::duration<double>(runner_looks_ * kLook).count());
    }
    if (hangs_ != before) StepInsideChange(false, false);
  });
  if (!hangs_ || before) return;
  Log("safety").critical("{}: lamps off, axes quick-stopped", hang_);
  (void)DeEnergise();
  clock_.Disown(name);  // the rig's time goes on without it
}

uint64_t Safety::stops() const {
  uint64_t stops = 0;
  clock_.Read([&] { stops = seen_.stops; });
  return stops;
}

Status Safety::Health() const {
  {
    const std::lock_guard lock(stop_mutex_);
    if (HostClock::now() - stop_round_ > kHealthLimit) {
      return Unavailable("safety: the stop thread does not go round for {} s",
                         kHealthLimit.count());
    }
  }
  for (const RigClock::Runner& runner : clock_.Runners()) {
    if (runner.running < kHealthLimit) continue;
    return Unavailable("safety: {} makes no progress for {:.0f} s", runner.name,
                       std::chrono::duration<double>(runner.running).count());
  }
  Status status;
  clock_.Read([&] {
    if (flags_.hung || hangs_) status = Unavailable("safety: {}", hang_);
  });
  return status;
}

}  // namespace mesorig::daemon
