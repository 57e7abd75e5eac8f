#pragma once
// Two clocks (DESIGN, "Two clocks"; docs/lockstep.md).
//
// RigClock is physics: device deadlines, settling, exposure. On hardware it is the system's
// monotonic clock; with the simulator in lockstep it is virtual and belongs to the simulator.
// HostClock (std::chrono::steady_clock) is the outside: clients, leases, disk, supervision.
//
// A thread that waits for devices is a *rig thread*: it holds a RigClock::Member for its life and
// waits only here. Virtual time stands still while any member runs. All state that one rig thread
// writes and another one waits for is changed inside Change() and read inside predicates or Read():
// the clock is their monitor, so that "who waits" and "what for" are always known together.

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <list>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace mesorig {

using RigTime = std::chrono::nanoseconds;  // since the rig (or the simulation) started
inline constexpr RigTime kNever = RigTime::max();

inline double Seconds(RigTime t) { return static_cast<double>(t.count()) * 1e-9; }
RigTime FromSeconds(double seconds);  // rounds to nanoseconds; saturates at kNever

enum class Pace {
  kFree,      // as fast as the simulation goes
  kRealTime,  // one second a second: jogging, manual leases
};

// Thread-safe.
class RigClock {
 public:
  virtual ~RigClock() = default;

  // Registers the calling thread under a name that the watchdog reports. Members are created and
  // destroyed on the thread that they stand for.
  class Member {
   public:
    Member(RigClock& clock, std::string name);
    ~Member();
    Member(const Member&) = delete;
    Member& operator=(const Member&) = delete;

   private:
    RigClock& clock_;
  };

  // While at least one is alive, time passes; with none (idle, paused, waiting for an operator)
  // virtual time stands still. Real time on hardware passes regardless. The slowest pace wins.
  class Activity {
   public:
    Activity(RigClock& clock, Pace pace);
    ~Activity();
    Activity(const Activity&) = delete;
    Activity& operator=(const Activity&) = delete;
    // Between these it does not count: a plan that waits for the operator.
    void Suspend() { Count(-1); }
    void Continue() { Count(1); }

   private:
    void Count(int change);
    RigClock& clock_;
    Pace pace_;
  };

  RigTime Now() const;

  // Blocks the calling member until ready() is true (returns true) or the deadline has come
  // (returns ready()). `ready` runs under the clock's lock, possibly on another thread; it reads
  // state only.
  bool WaitUntil(RigTime deadline, const std::function<bool()>& ready);
  bool WaitFor(RigTime span, const std::function<bool()>& ready);
  void SleepFor(RigTime span);

  // Runs `change` under the clock's lock, then wakes every member whose predicate became true
  // before time can pass. Any thread may call it.
  void Change(const std::function<void()>& change);
  void Read(const std::function<void()>& read) const {
    std::lock_guard lock(mutex_);
    read();
  }

  // Names of the members that are not waiting, and for how long they have been running in host
  // time: who holds time.
  struct Runner {
    std::string name;
    std::chrono::nanoseconds running;
  };
  std::vector<Runner> Runners() const;
  // The member of that name hangs: until it waits again time does not wait for it. What then
  // happens is not reproducible any more.
  void Disown(std::string_view name);

 protected:
  struct Entry {
    std::string name;
    std::thread::id thread;
    bool waiting = false;
    bool disowned = false;
    RigTime deadline{};
    const std::function<bool()>* ready = nullptr;
    std::condition_variable wake;
    std::chrono::steady_clock::time_point running_since;
  };

  virtual RigTime NowLocked() const = 0;
  // A member went to wait, an activity began or ended, or something was changed.
  virtual void OnChangeLocked(std::unique_lock<std::mutex>& lock) = 0;
  // A member was disowned.
  virtual void OnDisownLocked() {}
  // Waits on `entry.wake` until `entry.waiting` is false; real clocks also look at the time.
  virtual void BlockLocked(std::unique_lock<std::mutex>& lock, Entry& entry) = 0;

  // Marks those that can run: predicate true or deadline come.
  void WakeReadyLocked();
  // Those that wait, for a clock whose way of waiting changes.
  std::vector<Entry*> WaitingLocked();
  // Every member (but those disowned) waits, and at least one activity is on.
  bool QuiescentLocked() const;
  RigTime EarliestDeadlineLocked() const;
  Pace PaceLocked() const { return real_time_activities_ > 0 ? Pace::kRealTime : Pace::kFree; }
  bool ActiveLocked() const { return free_activities_ + real_time_activities_ > 0; }

  mutable std::mutex mutex_;

 private:
  Entry& EntryOfThisThreadLocked();
  std::list<Entry> entries_;
  int free_activities_ = 0, real_time_activities_ = 0;
};

// The system's monotonic clock, zero at construction: the rig clock of real hardware.
class SystemRigClock final : public RigClock {
 public:
  SystemRigClock() : start_(std::chrono::steady_clock::now()) {}

 protected:
  RigTime NowLocked() const override { return std::chrono::steady_clock::now() - start_; }
  void OnChangeLocked(std::unique_lock<std::mutex>& lock) override;
  void BlockLocked(std::unique_lock<std::mutex>& lock, Entry& entry) override;

 private:
  const std::chrono::steady_clock::time_point start_;
};

// A queue between rig threads, or from a port's reader to a rig thread. Any thread pushes; one
// member pops.
template <typename T>
class RigQueue {
 public:
  explicit RigQueue(RigClock& clock) : clock_(clock) {}
  void Push(T item) {
    clock_.Change([&] { items_.push_back(std::move(item)); });
  }
  // For callers that already are inside Change().
  void PushInsideChange(T item) { items_.push_back(std::move(item)); }
  std::optional<T> Pop(RigTime deadline) {
    clock_.WaitUntil(deadline, [&] { return !items_.empty(); });
    std::optional<T> item;
    clock_.Change([&] {
      if (items_.empty()) return;
      item = std::move(items_.front());
      items_.pop_front();
    });
    return item;
  }
  bool EmptyInsideChange() const { return items_.empty(); }
  size_t SizeInsideChange() const { return items_.size(); }
  void Clear() {
    clock_.Change([&] { items_.clear(); });
  }

 private:
  RigClock& clock_;
  std::deque<T> items_;  // guarded by the clock's lock
};

}  // namespace mesorig
