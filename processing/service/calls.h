#pragma once
// Internal to processing/service: calls to the daemon that can be ended from outside.

#include <grpcpp/client_context.h>

#include <chrono>
#include <optional>
#include <set>

#include "protocol/base/mutex.h"

namespace mesorig::service {

// Ends every call and every sleep that was begun with it, now and later. Thread-safe.
class StopSignal {
 public:
  void Stop() {
    MutexLock lock(mutex_);
    stopped_ = true;
    for (grpc::ClientContext* context : contexts_) context->TryCancel();
    changed_.NotifyAll();
  }
  bool stopped() const {
    MutexLock lock(mutex_);
    return stopped_;
  }
  // False when it was stopped before the time was over.
  bool SleepFor(std::chrono::milliseconds span) {
    const auto until = std::chrono::steady_clock::now() + span;
    MutexLock lock(mutex_);
    while (!stopped_) {
      const auto left = until - std::chrono::steady_clock::now();
      if (left <= std::chrono::nanoseconds::zero()) return true;
      changed_.WaitFor(mutex_, left);
    }
    return false;
  }

 private:
  friend class Call;
  mutable Mutex mutex_;
  CondVar changed_;
  bool stopped_ GUARDED_BY(mutex_) = false;
  std::set<grpc::ClientContext*> contexts_ GUARDED_BY(mutex_);
};

// The context of one call; a call begun after Stop is cancelled from the start.
class Call {
 public:
  explicit Call(StopSignal& signal, std::optional<double> timeout_s = {}) : signal_(signal) {
    if (timeout_s) {
      context_.set_deadline(std::chrono::system_clock::now() +
                            std::chrono::milliseconds(static_cast<int64_t>(*timeout_s * 1000)));
    }
    MutexLock lock(signal_.mutex_);
    signal_.contexts_.insert(&context_);
    if (signal_.stopped_) context_.TryCancel();
  }
  ~Call() {
    MutexLock lock(signal_.mutex_);
    signal_.contexts_.erase(&context_);
  }
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;
  grpc::ClientContext* context() { return &context_; }

 private:
  StopSignal& signal_;
  grpc::ClientContext context_;
};

}  // namespace mesorig::service
