#include "protocol/wire/stop_line.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <thread>

#include "protocol/base/unique_fd.h"

namespace mesorig::wire {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr std::string_view kStop = "stop", kOk = "ok\n", kError = "error ";
constexpr std::chrono::milliseconds kBetweenTries{5};

// Waits until `fd` can do `events`; false after the deadline.
bool Await(int fd, short events, HostClock::time_point deadline) {
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - HostClock::now());
    if (left.count() <= 0) return false;
    pollfd poll{fd, events, 0};
    const int ready = ::poll(&poll, 1, static_cast<int>(left.count()));
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
  }
}

StatusOr<UniqueFd> Dial(const std::filesystem::path& path, HostClock::time_point deadline) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.string().size() >= sizeof(address.sun_path)) {
    return InvalidArgument("{}: longer than the {} bytes of a socket's path", path.string(),
                           sizeof(address.sun_path) - 1);
  }
  std::memcpy(address.sun_path, path.c_str(), path.string().size());
  UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  while (::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    const std::string why = fmt::format("{}: {}", path.string(), std::strerror(errno));
    if (errno == ENOENT || errno == ECONNREFUSED) return NotFound("{}", why);
    // (EAGAIN: others come faster than they are let in.)
    const bool again = errno == EAGAIN || errno == EINTR;
    if (!again || HostClock::now() > deadline) return Unavailable("{}", why);
    std::this_thread::sleep_for(kBetweenTries);
  }
  return fd;
}

}  // namespace

std::filesystem::path StopSocket(const std::filesystem::path& runtime_dir) {
  return runtime_dir / "mesorigd.stop.sock";
}

std::string StopLine(std::string_view reason) {
  std::string line(kStop);
  if (!reason.empty()) line += ' ';
  line += reason.substr(0, kMaxStopLine - line.size() - 1);
  std::replace_if(
      line.begin(), line.end(),
      [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }, ' ');
  return line + '\n';
}

StatusOr<std::string> ReadStopLine(std::string_view line) {
  const bool is_stop = line == kStop || (line.starts_with(kStop) && line[kStop.size()] == ' ');
  if (!is_stop || line.size() >= kMaxStopLine) {
    return InvalidArgument("{} bytes are no \"stop REASON\"", line.size());
  }
  std::string reason(line.substr(std::min(line.size(), kStop.size() + 1)));
  std::replace_if(
      reason.begin(), reason.end(),
      [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }, ' ');
  return reason;
}

Status SayStop(const std::filesystem::path& socket, std::string_view reason,
               std::chrono::milliseconds patience) {
  const auto deadline = HostClock::now() + patience;
  MESORIG_ASSIGN_OR_RETURN(const UniqueFd fd, Dial(socket, deadline));
  const std::string line = StopLine(reason);
  // (A line this short goes whole into an empty buffer.)
  if (::send(fd.get(), line.data(), line.size(), MSG_NOSIGNAL) !=
      static_cast<ssize_t>(line.size())) {
    return Unavailable("{}: does not take a stop: {}", socket.string(), std::strerror(errno));
  }
  std::string answer;
  while (answer.empty() || answer.back() != '\n') {
    char buffer[1024];
    if (!Await(fd.get(), POLLIN, deadline)) {
      return Unavailable("{}: does not answer within {} ms", socket.string(), patience.count());
    }
    const ssize_t got = ::recv(fd.get(), buffer, sizeof(buffer), 0);
    if (got < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (got <= 0 || answer.size() > 8192) {
      return Unavailable("{}: closed without an answer", socket.string());
    }
    answer.append(buffer, static_cast<size_t>(got));
  }
  if (answer == kOk) return OkStatus();
  if (!answer.starts_with(kError)) {
    return Unavailable("{}: an answer that is none", socket.string());
  }
  answer.pop_back();
  return Internal("{}", std::string_view(answer).substr(kError.size()));
}

}  // namespace mesorig::wire
