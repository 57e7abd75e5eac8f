#include "protocol/base/service_manager.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>

#include "protocol/base/log.h"

namespace mesorig {
namespace {

std::string Environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

template <typename T>
std::optional<T> WholeNumber(const std::string& text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::optional<std::chrono::microseconds> WatchdogOfEnvironment() {
  const std::string usec = Environment("WATCHDOG_USEC"), pid = Environment("WATCHDOG_PID");
  if (usec.empty()) return std::nullopt;
  if (!pid.empty() && WholeNumber<pid_t>(pid) != ::getpid()) return std::nullopt;
  const auto value = WholeNumber<int64_t>(usec);
  if (!value || *value <= 0) {
    Log("program").warn("WATCHDOG_USEC=\"{}\" is no number of microseconds: no watchdog", usec);
    return std::nullopt;
  }
  return std::chrono::microseconds(*value);
}

// One line.
std::string StatusLine(std::string_view status) {
  std::string line = fmt::format("STATUS={}", status);
  for (char& c : line) {
    if (c == '\n' || c == '\0') c = ' ';
  }
  return line;
}

}  // namespace

ServiceManager::ServiceManager()
    : socket_(Environment("NOTIFY_SOCKET")), watchdog_(WatchdogOfEnvironment()) {
  const bool known = socket_.empty() || socket_[0] == '/' || socket_[0] == '@';
  if (known && socket_.size() < sizeof(sockaddr_un::sun_path)) return;
  Log("program").warn("NOTIFY_SOCKET=\"{}\" is no path of a socket: systemd is told nothing",
                      socket_);
  socket_.clear();
}

Status ServiceManager::Send(std::string_view message) const {
  if (socket_.empty()) return OkStatus();
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, socket_.data(), socket_.size());
  if (address.sun_path[0] == '@') address.sun_path[0] = '\0';  // an abstract name
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + socket_.size());
  const int fd = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return Unavailable("{}: {}", socket_, std::strerror(errno));
  const ssize_t sent = ::sendto(fd, message.data(), message.size(), MSG_NOSIGNAL,
                                reinterpret_cast<const sockaddr*>(&address), length);
  const int error = errno;
  ::close(fd);
  if (sent < 0) return Unavailable("{}: {}", socket_, std::strerror(error));
  return OkStatus();
}

Status ServiceManager::Ready(std::string_view status) const {
  return Send(fmt::format("READY=1\n{}", StatusLine(status)));
}

Status ServiceManager::Reloading() const {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return Send(fmt::format("RELOADING=1\nMONOTONIC_USEC={}",
                          int64_t{now.tv_sec} * 1'000'000 + now.tv_nsec / 1000));
}

Status ServiceManager::Stopping(std::string_view status) const {
  return Send(fmt::format("STOPPING=1\n{}", StatusLine(status)));
}

Status ServiceManager::Say(std::string_view status) const { return Send(StatusLine(status)); }

Status ServiceManager::Alive() const { return Send("WATCHDOG=1"); }

}  // namespace mesorig
