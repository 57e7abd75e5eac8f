#pragma once
// What a service tells systemd, spoken directly over $NOTIFY_SOCKET (sd_notify(3)): one datagram a
// message. Without that variable nothing is said, and everything else is the same.

#include <chrono>
#include <optional>
#include <string>
#include <string_view>

#include "protocol/base/status.h"

namespace mesorig {

// Not thread-safe: of the main thread.
class ServiceManager {
 public:
  // $NOTIFY_SOCKET (a path, or @name of an abstract socket) and $WATCHDOG_USEC, which counts when
  // $WATCHDOG_PID is this process or not said. What is malformed is logged and left out.
  ServiceManager();
  ServiceManager(std::string socket, std::optional<std::chrono::microseconds> watchdog)
      : socket_(std::move(socket)), watchdog_(watchdog) {}

  // Somebody listens.
  bool present() const { return !socket_.empty(); }
  // A service that does not call Alive within so long is killed and started again.
  std::optional<std::chrono::microseconds> watchdog() const { return watchdog_; }

  // Each returns Unavailable when nobody took it; nothing depends on it.
  Status Ready(std::string_view status) const;
  Status Reloading() const;  // until the next Ready
  Status Stopping(std::string_view status) const;
  Status Say(std::string_view status) const;  // one line, for `systemctl status`
  Status Alive() const;                       // feeds the watchdog

 private:
  Status Send(std::string_view message) const;
  std::string socket_;
  std::optional<std::chrono::microseconds> watchdog_;
};

}  // namespace mesorig
