#pragma once
// The daemon's events, numbered, the last ones kept for clients that come late or come back.

#include <chrono>
#include <cstdint>
#include <deque>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/mutex.h"
#include "protocol/messages/control.pb.h"

namespace mesorig::daemon {

inline constexpr size_t kEventsKept = 8192;

// Thread-safe.
class EventLog {
 public:
  // `life` tells this daemon's numbers from those of one before or after it; empty: a random one.
  explicit EventLog(size_t kept = kEventsKept, std::string life = {});
  // Numbers the event (from 1) and keeps it.
  void Append(v1::Event event) EXCLUDES(mutex_);
  // Events after `after`, in order, each with its age; waits at most `wait` of host time for one.
  // When some of them are no longer kept, or `after` is of another life (`life` says so, or no such
  // number was given yet), the first event is a Gap. Empty: none came, or the log is closed and all
  // were read.
  std::vector<v1::Event> Read(uint64_t after, std::string_view life, std::chrono::milliseconds wait)
      EXCLUDES(mutex_);
  uint64_t last() const EXCLUDES(mutex_);  // number of the latest; 0: none
  const std::string& life() const { return life_; }
  // Wakes and turns away all readers.
  void Close() EXCLUDES(mutex_);
  bool closed() const EXCLUDES(mutex_);

 private:
  using HostTime = std::chrono::steady_clock::time_point;
  struct Kept {
    v1::Event event;
    HostTime at;
  };
  v1::Event Gap(uint64_t first, uint64_t last, bool other_life) const;

  const size_t kept_;
  const std::string life_;
  mutable Mutex mutex_;
  CondVar changed_;
  std::deque<Kept> events_ GUARDED_BY(mutex_);
  uint64_t last_ GUARDED_BY(mutex_) = 0;
  bool closed_ GUARDED_BY(mutex_) = false;
};

}  // namespace mesorig::daemon
