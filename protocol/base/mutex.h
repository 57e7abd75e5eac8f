#pragma once
// std::mutex with the annotations that clang's -Wthread-safety checks. (The packaged
// absl::Mutex trips ThreadSanitizer.)

// GUARDED_BY and NO_THREAD_SAFETY_ANALYSIS are abseil's, the others are here.
#include <absl/base/thread_annotations.h>

#include <chrono>
#include <condition_variable>
#include <mutex>

#if defined(__clang__)
#define MESORIG_THREAD_ATTRIBUTE_(x) __attribute__((x))
#else
#define MESORIG_THREAD_ATTRIBUTE_(x)
#endif
#define CAPABILITY(x) MESORIG_THREAD_ATTRIBUTE_(capability(x))
#define SCOPED_CAPABILITY MESORIG_THREAD_ATTRIBUTE_(scoped_lockable)
#define REQUIRES(...) MESORIG_THREAD_ATTRIBUTE_(requires_capability(__VA_ARGS__))
#define EXCLUDES(...) MESORIG_THREAD_ATTRIBUTE_(locks_excluded(__VA_ARGS__))
#define ACQUIRE(...) MESORIG_THREAD_ATTRIBUTE_(acquire_capability(__VA_ARGS__))
#define RELEASE(...) MESORIG_THREAD_ATTRIBUTE_(release_capability(__VA_ARGS__))

namespace mesorig {

class CAPABILITY("mutex") Mutex {
 public:
  Mutex() = default;
  Mutex(const Mutex&) = delete;
  Mutex& operator=(const Mutex&) = delete;
  void lock() ACQUIRE() { mutex_.lock(); }
  void unlock() RELEASE() { mutex_.unlock(); }

 private:
  std::mutex mutex_;
};

class SCOPED_CAPABILITY MutexLock {
 public:
  explicit MutexLock(Mutex& mutex) ACQUIRE(mutex) : mutex_(mutex) { mutex_.lock(); }
  ~MutexLock() RELEASE() { mutex_.unlock(); }
  MutexLock(const MutexLock&) = delete;
  MutexLock& operator=(const MutexLock&) = delete;

 private:
  Mutex& mutex_;
};

// Waits with a Mutex held; the caller loops on its own condition.
class CondVar {
 public:
  void Wait(Mutex& mutex) REQUIRES(mutex) NO_THREAD_SAFETY_ANALYSIS { condition_.wait(mutex); }
  // False when `timeout` of host time passed.
  bool WaitFor(Mutex& mutex, std::chrono::nanoseconds timeout)
      REQUIRES(mutex) NO_THREAD_SAFETY_ANALYSIS {
    return condition_.wait_for(mutex, timeout) == std::cv_status::no_timeout;
  }
  void NotifyAll() { condition_.notify_all(); }
  void NotifyOne() { condition_.notify_one(); }

 private:
  std::condition_variable_any condition_;
};

}  // namespace mesorig
