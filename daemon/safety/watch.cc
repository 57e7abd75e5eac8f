// Safety's watch: reads the rig, tells the logic, and takes the energy away.

#include <algorithm>
#include <utility>

#include "daemon/safety/safety.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

// Off the instants at which others command and drives answer (docs/lockstep.md).
constexpr RigTime kPhase{271'828};
// What is read back must disagree for so long with what was asked for.
constexpr double kPowerLost_s = 0.3, kContactorStuck_s = 0.3, kLaserStuck_s = 0.4;
constexpr double kMotionStuck_s = 3;  // a quick stop brakes first
constexpr double kDark = 0.05;        // of full flux
constexpr double kCooled_c = 10;      // below the limit, before the heat is gone
constexpr std::chrono::seconds kPollLimit{5};

// A lamp that shines and is not the one asked for; -1: none.
int LitUnasked(const std::vector<double>& levels, int asked) {
  for (size_t i = 0; i < levels.size(); ++i) {
    if (static_cast<int>(i) != asked && levels[i] > kDark) return static_cast<int>(i);
  }
  return -1;
}

}  // namespace

void Safety::Watch() {
  RigTime due = clock_.Now();
  bool calm = false;  // nothing was energised
  for (;;) {
    clock_.WaitUntil(due, [&] { return ending_ || act_ || (calm && EnergisedInsideChange()); });
    bool ending = false;
    uint64_t wanted = 0;
    clock_.Change([&] {
      ending = ending_;
      act_ = false;
      wanted = polls_wanted_;
    });
    if (ending) return;
    Poll(wanted != polls_done_);
    bool off = false;
    clock_.Read([&] {
      off = outputs_.de_energise;
      calm = !EnergisedInsideChange();
    });
    if (off) (void)DeEnergise();
    PutOut();
    TellTrips();
    polls_done_ = wanted;
    {
      const std::lock_guard lock(stop_mutex_);
      polled_.notify_all();
    }
    const RigTime now = clock_.Now();
    hours_.Tick(now);
    const RigTime period = FromSeconds(calm ? kCalmPoll_s : kPoll_s);
    due = now - now % period + kPhase;
    if (due <= now) due += period;
  }
}

void Safety::Poll(bool lamps_too) {
  const RigTime now = clock_.Now();
  PollLines(now);
  PollAxes(now);
  bool look = false, energised = false;
  clock_.Change([&] {
    energised = EnergisedInsideChange();
    flags_.hung = energised && now - alive_until_ > alive_limit_;
    if (flags_.hung) {
      hang_ = fmt::format("no progress for {:.1f} s while the rig is energised",
                          Seconds(now - alive_until_));
    }
    // Dark is what was read as dark: a bank that could not be read may have kept a lamp on.
    look = lamps_too || now >= (energised || !dark_seen_ ? lamps_due_ : calm_lamps_due_);
    StepInsideChange(false, false);
  });
  if (look) PollLamps(now);
}

void Safety::PollLines(RigTime now) {
  (void)chain_.Check();  // what is wrong goes into the logic
  const Lines& numbers = rig_.lines;
  const auto read = [&](int line, bool unknown) {
    if (devices_.lines == nullptr || line < 0) return unknown;
    return devices_.lines->Read(line).value_or(unknown);
  };
  const bool power = read(numbers.power, false);
  const bool laser = read(numbers.laser_on, false);
  clock_.Change([&] {
    seen_.power = power;
    seen_.laser_on = laser;
    seen_.lines_read_at = now;
    const bool closed = seen_.chain.readable && seen_.chain.estop && seen_.chain.door;
    if (seen_.has_power_line && numbers.interlock) {
      flags_.power_lost = power_lost_.Update(closed && !power, now, FromSeconds(kPowerLost_s));
      flags_.contactor_stuck =
          contactor_stuck_.Update(seen_.chain.readable && !closed && power, now,
                                  FromSeconds(kContactorStuck_s));
    }
    const bool shut = gate_ == nullptr || !gate_->OpenInsideChange();
    flags_.laser_stuck = laser_stuck_.Update(laser && shut, now, FromSeconds(kLaserStuck_s));
    StepInsideChange(false, false);
  });
}

void Safety::PollAxes(RigTime now) {
  std::vector<AxisReading> axes;
  for (const Axis* axis : devices_.axes) axes.push_back(axis->Read());
  clock_.Change([&] {
    bool unasked = false;
    for (size_t i = 0; i < axes.size(); ++i) unasked |= axes[i].torque && !torque_asked_[i];
    seen_.axes = std::move(axes);
    flags_.motion_stuck = motion_stuck_.Update(unasked, now, FromSeconds(kMotionStuck_s));
    StepInsideChange(false, false);
  });
}

void Safety::PollLamps(RigTime now) {
  lamps_due_ = now + FromSeconds(kLampPoll_s);
  calm_lamps_due_ = now + FromSeconds(kCalmLampPoll_s);
  const auto readings = devices_.lamps->Watch();
  if (!readings.ok()) {  // shows by the age of what was read last; the bank's own timeout acts
    Log("safety").debug("safety: {}", Message(readings.status()));
    return;
  }
  const double limit_c = rig_.lamp_bank.max_housing_c;
  clock_.Change([&] {
    seen_.lamp_level = readings->levels;
    seen_.housing_c = readings->housing_c;
    seen_.lamps_read_at = now;
    const int lit = LitUnasked(readings->levels, lamp_asked_);
    flags_.light_stuck = now >= dark_at_ && lit >= 0;
    dark_seen_ = now >= dark_at_ && lit < 0;
    if (flags_.light_stuck) {
      light_ = fmt::format(
          "lamp {} is lit, level {:.3f}, and nobody asked for it; if it stays so, the emergency stop "
          "cuts its supply",
          rig_.lamps[lit].name, readings->levels[lit]);
    }
    for (size_t i = 0; i < readings->housing_c.size() && limit_c > 0; ++i) {
      if (readings->housing_c[i] <= limit_c) continue;
      heat_ = fmt::format("lamp {}: its housing has {:.1f} degrees C, permitted are {:g}",
                          rig_.lamps[i].name, readings->housing_c[i], limit_c);
      flags_.hot = true;
    }
    const bool cool = std::all_of(readings->housing_c.begin(), readings->housing_c.end(),
                                  [&](double c) { return c < limit_c - kCooled_c; });
    if (cool) flags_.hot = false;
    StepInsideChange(false, false);
  });
}

// What was told to go dark and did not hear it, until it does: nobody else tries again.
void Safety::PutOut() {
  const RigTime now = clock_.Now();
  bool owed = false;
  clock_.Read([&] { owed = off_owed_; });
  if (!owed) off_due_ = now + FromSeconds(kOffRetry_s);
  if (!owed || now < off_due_) return;
  off_due_ = now + FromSeconds(kOffRetry_s);
  const Status off = guarded_lamps_->AllOff();
  if (off.ok()) Log("safety").warn("safety: the lamps could not be switched off, and are now");
}

void Safety::TellTrips() {
  std::vector<std::string> trips;
  clock_.Change([&] { trips = std::exchange(untold_, {}); });
  for (const std::string& trip : trips) {
    Log("safety").error("{}", trip);
    on_trip_.Tell(trip);
  }
}

Status Safety::DeEnergise() {
  if (gate_) gate_->Shut();  // the one-shot does the rest
  Status first;
  for (size_t i = 0; i < devices_.axes.size(); ++i) {
    const Status stopped = devices_.axes[i]->QuickStop();
    if (stopped.ok()) {
      AskTorque(i, false);
    } else if (first.ok()) {
      first = stopped;
    }
  }
  const Status off = guarded_lamps_->AllOff();
  // (Tried ten times a second: told once.)
  bool told = false;
  clock_.Change([&] { told = std::exchange(off_trouble_, std::string(Message(off))) == Message(off); });
  if (!off.ok() && !told) Log("safety").error("safety: {}", Message(off));
  return off.ok() ? first : off;
}

void Safety::PollNow() {
  uint64_t wanted = 0;
  clock_.Change([&] {
    wanted = ++polls_wanted_;
    act_ = true;
  });
  std::unique_lock lock(stop_mutex_);
  if (!polled_.wait_for(lock, kPollLimit, [&] { return polls_done_ >= wanted; })) {
    Log("safety").error("safety: the watch does not answer within {} s", kPollLimit.count());
  }
}

}  // namespace mesorig::daemon
