#include "daemon/service/event_log.h"

#include <fmt/core.h>

#include <algorithm>

namespace mesorig::daemon {
namespace {

constexpr size_t kBatch = 256;

v1::Event Note(uint64_t sequence, std::string text) {
  v1::Event note;
  note.set_sequence(sequence);
  note.set_note(std::move(text));
  return note;
}

}  // namespace

uint64_t EventLog::last() const {
  MutexLock lock(mutex_);
  return last_;
}

void EventLog::Append(v1::Event event) {
  MutexLock lock(mutex_);
  event.set_sequence(++last_);
  events_.push_back(std::move(event));
  if (events_.size() > kept_) events_.pop_front();
  changed_.NotifyAll();
}

std::vector<v1::Event> EventLog::Read(uint64_t after, std::chrono::milliseconds wait) {
  const auto deadline = std::chrono::steady_clock::now() + wait;
  std::vector<v1::Event> batch;
  MutexLock lock(mutex_);
  if (after > last_) {
    batch.push_back(Note(0, fmt::format("event {} is of an earlier run of mesorigd; these begin "
                                        "anew",
                                        after)));
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
    batch.push_back(
        Note(first - 1, fmt::format("{} earlier events are no longer kept", first - 1 - after)));
    after = first - 1;
  }
  const auto begin = events_.begin() + static_cast<std::ptrdiff_t>(after + 1 - first);
  const auto count = std::min<std::ptrdiff_t>(kBatch, events_.end() - begin);
  batch.insert(batch.end(), begin, begin + count);
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
