#include "daemon/bus/device_claim.h"

#include <sys/socket.h>
#include <sys/un.h>

#include <cerrno>
#include <cstddef>
#include <cstring>
#include <fstream>

namespace mesorig::daemon {
namespace {

// Who listens there, as the kernel tells whoever connects.
std::string HolderOf(const sockaddr_un& address, socklen_t size) {
  const UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  ucred who{};
  socklen_t length = sizeof(who);
  if (::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), size) != 0 ||
      ::getsockopt(fd.get(), SOL_SOCKET, SO_PEERCRED, &who, &length) != 0) {
    return "another process";
  }
  std::string command;
  std::ifstream(fmt::format("/proc/{}/comm", who.pid)) >> command;
  return fmt::format("process {} ({})", who.pid, command.empty() ? "?" : command);
}

}  // namespace

StatusOr<UniqueFd> ClaimDevice(const std::string& device) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string name = "mesorig/" + device;  // after a zero: no file
  if (name.size() >= sizeof(address.sun_path)) {
    return InvalidArgument("device \"{}\": its name has more than {} bytes", device,
                           sizeof(address.sun_path) - 9);
  }
  std::memcpy(address.sun_path + 1, name.data(), name.size());
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), size) != 0) {
    if (errno != EADDRINUSE) return Unavailable("{}: claiming it: {}", device, std::strerror(errno));
    return FailedPrecondition("{} is in use by {}", device, HolderOf(address, size));
  }
  if (::listen(fd.get(), 1) != 0) {
    return Unavailable("{}: claiming it: {}", device, std::strerror(errno));
  }
  return fd;
}

}  // namespace mesorig::daemon
