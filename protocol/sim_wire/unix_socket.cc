#include "protocol/sim_wire/unix_socket.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace mesorig::sim_wire {
namespace {

StatusOr<sockaddr_un> Address(const std::filesystem::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string name = path.string();
  if (name.size() >= sizeof(address.sun_path)) {
    return InvalidArgument("socket path {} exceeds {} bytes", name, sizeof(address.sun_path) - 1);
  }
  std::memcpy(address.sun_path, name.data(), name.size());
  return address;
}

}  // namespace

Fd& Fd::operator=(Fd&& other) noexcept {
  if (this != &other) {
    Close();
    fd_ = other.Release();
  }
  return *this;
}

void Fd::Close() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

StatusOr<Fd> Listen(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const sockaddr_un address, Address(path));
  Fd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!fd.valid() ||
      ::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
      ::listen(fd.get(), 16) != 0) {
    return FailedPrecondition("socket {}: {}", path.string(), strerror(errno));
  }
  return fd;
}

StatusOr<Fd> Connect(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const sockaddr_un address, Address(path));
  Fd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!fd.valid() ||
      ::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    return Unavailable("socket {}: {}", path.string(), strerror(errno));
  }
  return fd;
}

Status SendAll(int fd, std::string_view bytes, int timeout_ms) {
  while (!bytes.empty()) {
    const ssize_t n = ::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n > 0) {
      bytes.remove_prefix(static_cast<size_t>(n));
      continue;
    }
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno != EAGAIN && errno != EWOULDBLOCK) {
      return Unavailable("peer is gone: {}", strerror(errno));
    }
    pollfd waiting{fd, POLLOUT, 0};
    if (::poll(&waiting, 1, timeout_ms) == 0) {
      return Unavailable("peer has taken nothing for {} ms", timeout_ms);
    }
  }
  return OkStatus();
}

StatusOr<size_t> ReceiveSome(int fd, char* buffer, size_t size) {
  for (;;) {
    const ssize_t n = ::recv(fd, buffer, size, 0);
    if (n >= 0) return static_cast<size_t>(n);
    if (errno != EINTR) return Unavailable("receive: {}", strerror(errno));
  }
}

}  // namespace mesorig::sim_wire
