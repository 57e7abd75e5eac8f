#pragma once
// Feeds systemd's watchdog, and only while every part that must make progress does. Whoever hangs
// gets the daemon killed and started again; lamps, laser and torque go off by themselves meanwhile
// (docs/safety.md).

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "protocol/base/service_manager.h"

namespace mesorig::daemon {

// A part of the daemon that must make progress.
struct ProgressSource {
  std::string name;
  // Host time for which it has owed a sign of life; zero while it waits for something as it should.
  // Called on the watchdog's thread; must not block.
  std::function<std::chrono::nanoseconds()> silent_for;
};

// Not thread-safe: of the supervising thread, whose own life is part of what is watched.
class Watchdog {
 public:
  using HostClock = std::chrono::steady_clock;
  // `manager` is borrowed. A source may be silent for half of the manager's limit: then the rest is
  // left for it to come back before the kill.
  Watchdog(const ServiceManager& manager, std::vector<ProgressSource> sources);

  // Call often. Feeds four times in the manager's limit, unless a source is silent: that is logged
  // when it begins and when it ends. Returns the name of the silent one, empty when all is well.
  std::string Look(HostClock::time_point now);
  struct Silence {
    std::string name;
    std::chrono::nanoseconds silent{};
  };
  std::vector<Silence> Silences() const;  // any thread
  std::chrono::nanoseconds limit() const { return limit_; }

 private:
  const ServiceManager& manager_;
  const std::vector<ProgressSource> sources_;
  const std::chrono::nanoseconds limit_;
  std::optional<HostClock::time_point> fed_;
  std::string silent_;  // of the last look
};

}  // namespace mesorig::daemon
