#pragma once
// The rig by hand, in memory.

#include <fmt/core.h>

#include <future>
#include <optional>
#include <string>
#include <vector>

#include "daemon/control/manual_control.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

// Remembers the fence, and does at once what is asked.
class FakeManual final : public ManualControl {
 public:
  void Admit(uint64_t token) override {
    const MutexLock lock(mutex_);
    newest_ = token;
    open_ = true;
  }
  void Close(uint64_t newest, std::string_view) override {
    const MutexLock lock(mutex_);
    newest_ = std::max(newest_, newest);
    open_ = false;
  }
  Status AwaitRest(double) override {
    const MutexLock lock(mutex_);
    return rest_;
  }
  void Stop(std::string_view) override {
    const MutexLock lock(mutex_);
    ++stops_;
    if (moving_) moving_->set_value(Cancelled("stopped"));
    moving_.reset();
  }
  Status Jog(uint64_t token, int axis, double rate_rad_s) override {
    return Note(token, fmt::format("jog {} {}", axis, rate_rad_s));
  }
  std::future<Status> MoveTo(uint64_t token, int axis, double target_rad) override {
    if (target_rad != 99) return Done(Note(token, fmt::format("move {} {}", axis, target_rad)));
    const MutexLock lock(mutex_);  // it never gets there
    moving_.emplace();
    return moving_->get_future();
  }
  std::future<Status> Home(uint64_t token, int axis) override {
    return Done(Note(token, fmt::format("home {}", axis)));
  }
  std::future<Status> SetLamp(uint64_t token, int lamp) override {
    return Done(Note(token, fmt::format("lamp {}", lamp)));
  }
  std::future<Status> TestLaser(uint64_t token, double seconds) override {
    return Done(Note(token, fmt::format("laser {}", seconds)));
  }
  ManualStatus GetStatus() const override {
    ManualStatus status;
    status.readings.push_back({"turntable", "rad", 0.5, RigTime(0), ReadingSource::kCommanded});
    return status;
  }
  void OnNote(std::function<void(const std::string&)>) override {}

  std::vector<std::string> said() const {
    const MutexLock lock(mutex_);
    return said_;
  }
  bool open() const {
    const MutexLock lock(mutex_);
    return open_;
  }
  int stops() const {
    const MutexLock lock(mutex_);
    return stops_;
  }
  void SetRest(Status rest) {
    const MutexLock lock(mutex_);
    rest_ = std::move(rest);
  }

 private:
  Status Note(uint64_t token, std::string what) {
    const MutexLock lock(mutex_);
    if (!open_ || token != newest_) return FailedPrecondition("fence: {} is not newest", token);
    said_.push_back(std::move(what));
    return OkStatus();
  }
  static std::future<Status> Done(Status status) {
    std::promise<Status> promise;
    promise.set_value(std::move(status));
    return promise.get_future();
  }
  mutable Mutex mutex_;
  uint64_t newest_ GUARDED_BY(mutex_) = 0;
  bool open_ GUARDED_BY(mutex_) = false;
  int stops_ GUARDED_BY(mutex_) = 0;
  Status rest_ GUARDED_BY(mutex_);
  std::vector<std::string> said_ GUARDED_BY(mutex_);
  std::optional<std::promise<Status>> moving_ GUARDED_BY(mutex_);
};

}  // namespace mesorig::daemon
