#include "protocol/base/clocks.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/check.h"

namespace mesorig {

RigTime FromSeconds(double seconds) {
  const double ns = std::round(seconds * 1e9);
  MESORIG_CHECK(!std::isnan(ns));
  if (ns >= 9.2e18) return kNever;
  if (ns <= -9.2e18) return RigTime::min();
  return RigTime(static_cast<int64_t>(ns));
}

RigClock::Member::Member(RigClock& clock, std::string name) : clock_(clock) {
  std::lock_guard lock(clock_.mutex_);
  Entry& entry = clock_.entries_.emplace_back();
  entry.name = std::move(name);
  entry.thread = std::this_thread::get_id();
  entry.running_since = std::chrono::steady_clock::now();
}

RigClock::Member::~Member() {
  std::unique_lock lock(clock_.mutex_);
  clock_.entries_.remove_if([](const Entry& e) { return e.thread == std::this_thread::get_id(); });
  clock_.OnChangeLocked(lock);
}

RigClock::Activity::Activity(RigClock& clock, Pace pace) : clock_(clock), pace_(pace) { Count(1); }

RigClock::Activity::~Activity() { Count(-1); }

void RigClock::Activity::Count(int change) {
  std::unique_lock lock(clock_.mutex_);
  (pace_ == Pace::kFree ? clock_.free_activities_ : clock_.real_time_activities_) += change;
  clock_.OnChangeLocked(lock);
}

RigTime RigClock::Now() const {
  std::lock_guard lock(mutex_);
  return NowLocked();
}

bool RigClock::WaitUntil(RigTime deadline, const std::function<bool()>& ready) {
  std::unique_lock lock(mutex_);
  if (ready()) return true;
  if (NowLocked() >= deadline) return false;
  Entry& entry = EntryOfThisThreadLocked();
  entry.waiting = true;
  entry.disowned = false;
  entry.deadline = deadline;
  entry.ready = &ready;
  OnChangeLocked(lock);
  BlockLocked(lock, entry);
  entry.ready = nullptr;
  return ready();
}

bool RigClock::WaitFor(RigTime span, const std::function<bool()>& ready) {
  return WaitUntil(Now() + span, ready);
}

void RigClock::SleepFor(RigTime span) {
  WaitFor(span, [] { return false; });
}

void RigClock::Change(const std::function<void()>& change) {
  std::unique_lock lock(mutex_);
  change();
  WakeReadyLocked();
  OnChangeLocked(lock);
}

std::vector<RigClock::Runner> RigClock::Runners() const {
  std::lock_guard lock(mutex_);
  const auto now = std::chrono::steady_clock::now();
  std::vector<Runner> runners;
  for (const Entry& entry : entries_) {
    if (!entry.waiting) runners.push_back({entry.name, now - entry.running_since});
  }
  return runners;
}

void RigClock::Disown(std::string_view name) {
  std::unique_lock lock(mutex_);
  for (Entry& entry : entries_) {
    if (entry.waiting || entry.name != name) continue;
    entry.disowned = true;
    OnDisownLocked();
  }
  OnChangeLocked(lock);
}

void RigClock::WakeReadyLocked() {
  const RigTime now = NowLocked();
  for (Entry& entry : entries_) {
    if (!entry.waiting || !(now >= entry.deadline || (*entry.ready)())) continue;
    entry.waiting = false;
    entry.running_since = std::chrono::steady_clock::now();
    entry.wake.notify_one();
  }
}

std::vector<RigClock::Entry*> RigClock::WaitingLocked() {
  std::vector<Entry*> waiting;
  for (Entry& entry : entries_) {
    if (entry.waiting) waiting.push_back(&entry);
  }
  return waiting;
}

bool RigClock::QuiescentLocked() const {
  return ActiveLocked() && std::all_of(entries_.begin(), entries_.end(),
                                       [](const Entry& entry) { return entry.waiting || entry.disowned; });
}

RigTime RigClock::EarliestDeadlineLocked() const {
  RigTime earliest = kNever;
  for (const Entry& entry : entries_) {
    if (entry.waiting) earliest = std::min(earliest, entry.deadline);
  }
  return earliest;
}

RigClock::Entry& RigClock::EntryOfThisThreadLocked() {
  const auto id = std::this_thread::get_id();
  for (Entry& entry : entries_) {
    if (entry.thread == id) return entry;
  }
  MESORIG_CHECK(false && "only a RigClock::Member may wait on the rig clock");
  std::abort();
}

void SystemRigClock::OnChangeLocked(std::unique_lock<std::mutex>&) {}

void SystemRigClock::BlockLocked(std::unique_lock<std::mutex>& lock, Entry& entry) {
  while (entry.waiting) {
    if (entry.deadline == kNever) {
      entry.wake.wait(lock);
    } else if (entry.wake.wait_until(lock, start_ + entry.deadline) == std::cv_status::timeout &&
               NowLocked() >= entry.deadline) {
      entry.waiting = false;
      entry.running_since = std::chrono::steady_clock::now();
    }
  }
}

}  // namespace mesorig
