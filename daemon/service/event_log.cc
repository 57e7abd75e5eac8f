#include "daemon/service/event_log.h"

#include <fmt/core.h>

#include <algorithm>
#include <random>

namespace mesorig::daemon {
namespace {

constexpr size_t kBatch = 256;

std::string RandomLife() {
  std::random_device random;
  return fmt::format("{:08x}{:08x}", random(), random());
}

}  // namespace

EventLog::EventLog(size_t kept, std::string life)
    : kept_(kept), life_(life.empty() ? RandomLife() : std::move(life)) {}

v1::Event EventLog::Gap(uint64_t first, uint64_t last, bool other_life) const {
  v1::Event event;
  event.set_sequence(last);
  event.set_life(life_);
  event.mutable_gap()->set_first(first);
  event.mutable_gap()->set_last(last);
  event.mutable_gap()->set_other_life(other_life);
  return event;
}

uint64_t EventLog::last() const {
  MutexLock lock(mutex_);
  return last_;
}

void EventLog::Append(v1::Event event) {
  const HostTime now = std::chrono::steady_clock::now();
  MutexLock lock(mutex_);
  event.set_sequence(++last_);
  event.set_life(life_);
  events_.push_back({std::move(event), now});
  if (events_.size() > kept_) events_.pop_front();
  changed_.NotifyAll();
}

std::vector<v1::Event> EventLog::Read(uint64_t after, std::string_view life,
                                      std::chrono::milliseconds wait) {
  const auto deadline = std::chrono::steady_clock::now() + wait;
  std::vector<v1::Event> batch;
  MutexLock lock(mutex_);
  if (after > last_ || (!life.empty() && life != life_)) {
    batch.push_back(Gap(0, 0, true));
    after = 0;
  }
  while (!closed_ && last_ == after && batch.empty()) {
    const auto left = deadline - std::chrono::steady_clock::now();
    if (left <= left.zero()) break;
    changed_.WaitFor(mutex_, left);
  }
  if (last_ == after) return batch;
  const uint64_t first = last_ - events_.size() + 1;
  if (after + 1 < first) {
    batch.push_back(Gap(after + 1, first - 1, false));
    after = first - 1;
  }
  const HostTime now = std::chrono::steady_clock::now();
  const auto begin = events_.begin() + static_cast<std::ptrdiff_t>(after + 1 - first);
  const auto count = std::min<std::ptrdiff_t>(kBatch, events_.end() - begin);
  for (auto at = begin; at != begin + count; ++at) {
    batch.push_back(at->event);
    batch.back().set_age_s(std::chrono::duration<double>(now - at->at).count());
  }
  return batch;
}

void EventLog::Close() {
  MutexLock lock(mutex_);
  closed_ = true;
  changed_.NotifyAll();
}

bool EventLog::closed() const {
  MutexLock lock(mutex_);
  return closed_;
}

}  // namespace mesorig::daemon
