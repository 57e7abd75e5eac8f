#pragma once
// Who hears of a stop or a trip, for as long as he wants to.

#include <functional>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/base/mutex.h"

namespace mesorig::daemon {

struct SafetyListener {
  Mutex mutex;  // held while it is called
  std::function<void(std::string_view why)> hear GUARDED_BY(mutex);
};

// Whoever holds it is called. Its destructor waits for a call that is under way (so that it must not
// be destroyed inside one, nor under the clock's lock); after it there are none.
class [[nodiscard]] Listening {
 public:
  Listening() = default;
  explicit Listening(std::shared_ptr<SafetyListener> listener)
      : listener_(std::move(listener)) {}
  ~Listening() {
    if (listener_ == nullptr) return;
    const MutexLock lock(listener_->mutex);
    listener_->hear = nullptr;
  }
  Listening(Listening&&) = default;
  Listening& operator=(Listening other) {
    std::swap(listener_, other.listener_);
    return *this;
  }

 private:
  std::shared_ptr<SafetyListener> listener_;  // shared with a call that is under way
};

// Thread-safe.
class SafetyListeners {
 public:
  Listening Add(std::function<void(std::string_view why)> hear) {
    auto listener = std::make_shared<SafetyListener>();
    {
      const MutexLock lock(listener->mutex);
      listener->hear = std::move(hear);
    }
    const MutexLock lock(mutex_);
    std::erase_if(all_, [](const auto& each) { return each.expired(); });
    all_.push_back(listener);
    return Listening(std::move(listener));
  }
  // In the order of their coming.
  void Tell(std::string_view why) {
    std::vector<std::weak_ptr<SafetyListener>> all;
    {
      const MutexLock lock(mutex_);
      all = all_;
    }
    for (const auto& each : all) {
      const std::shared_ptr<SafetyListener> listener = each.lock();
      if (listener == nullptr) continue;
      const MutexLock lock(listener->mutex);
      if (listener->hear) listener->hear(why);
    }
  }

 private:
  Mutex mutex_;
  std::vector<std::weak_ptr<SafetyListener>> all_ GUARDED_BY(mutex_);
};

}  // namespace mesorig::daemon
