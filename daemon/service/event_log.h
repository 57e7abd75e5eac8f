#pragma once
// The daemon's events, numbered, the last ones kept for clients that come late or come back.

#include <chrono>
#include <cstdint>
#include <deque>
#include <vector>

#include "protocol/base/mutex.h"
#include "protocol/messages/control.pb.h"

namespace mesorig::daemon {

inline constexpr size_t kEventsKept = 8192;

// Thread-safe.
class EventLog {
 public:
  explicit EventLog(size_t kept = kEventsKept) : kept_(kept) {}
  // Numbers the event (from 1) and keeps it.
  void Append(v1::Event event) EXCLUDES(mutex_);
  // Events after `after`, in order; waits at most `wait` of host time for one. When some of them
  // are no longer kept, or `after` is of an earlier life of the daemon, the first event is a note
  // that says so. Empty: none came, or the
  // log is closed and all were read.
  std::vector<v1::Event> Read(uint64_t after, std::chrono::milliseconds wait) EXCLUDES(mutex_);
  uint64_t last() const EXCLUDES(mutex_);  // number of the latest; 0: none
  // Wakes and turns away all readers.
  void Close() EXCLUDES(mutex_);
  bool closed() const EXCLUDES(mutex_);

 private:
  const size_t kept_;
  mutable Mutex mutex_;
  CondVar changed_;
  std::deque<v1::Event> events_ GUARDED_BY(mutex_);
  uint64_t last_ GUARDED_BY(mutex_) = 0;
  bool closed_ GUARDED_BY(mutex_) = false;
};

}  // namespace mesorig::daemon
