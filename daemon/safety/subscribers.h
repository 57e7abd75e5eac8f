#pragma once
// Who hears of a stop or a trip, for as long as he wants to.

#include <functional>
#include <memory>
#include <mutex>
#include <string_view>
#include <utility>
#include <vector>

namespace mesorig::daemon {

struct Subscriber {
  std::mutex mutex;  // held while it is called
  std::function<void(std::string_view why)> hear;
};

// Whoever holds it is called. Its destructor waits for a call that is under way (so that it must not
// be destroyed inside one, nor under the clock's lock); after it there are none.
class [[nodiscard]] Subscription {
 public:
  Subscription() = default;
  explicit Subscription(std::shared_ptr<Subscriber> subscriber)
      : subscriber_(std::move(subscriber)) {}
  ~Subscription() {
    if (subscriber_ == nullptr) return;
    const std::lock_guard lock(subscriber_->mutex);
    subscriber_->hear = nullptr;
  }
  Subscription(Subscription&&) = default;
  Subscription& operator=(Subscription other) {
    std::swap(subscriber_, other.subscriber_);
    return *this;
  }

 private:
  std::shared_ptr<Subscriber> subscriber_;  // shared with a call that is under way
};

// Thread-safe.
class Subscribers {
 public:
  Subscription Add(std::function<void(std::string_view why)> hear) {
    auto subscriber = std::make_shared<Subscriber>();
    subscriber->hear = std::move(hear);
    const std::lock_guard lock(mutex_);
    std::erase_if(all_, [](const auto& each) { return each.expired(); });
    all_.push_back(subscriber);
    return Subscription(std::move(subscriber));
  }
  // In the order of their coming.
  void Tell(std::string_view why) {
    std::vector<std::weak_ptr<Subscriber>> all;
    {
      const std::lock_guard lock(mutex_);
      all = all_;
    }
    for (const auto& each : all) {
      const std::shared_ptr<Subscriber> subscriber = each.lock();
      if (subscriber == nullptr) continue;
      const std::lock_guard lock(subscriber->mutex);
      if (subscriber->hear) subscriber->hear(why);
    }
  }

 private:
  std::mutex mutex_;
  std::vector<std::weak_ptr<Subscriber>> all_;
};

}  // namespace mesorig::daemon
