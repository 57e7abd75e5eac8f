#include "protocol/wire/listeners.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <grp.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <pwd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "protocol/base/log.h"

namespace mesorig::wire {
namespace {

constexpr int kBacklog = 64;
constexpr std::chrono::seconds kBetweenLines{1};
constexpr int kExhausted_ms = 100;  // without descriptors: until the next try

LocalPeer PeerOf(int fd) {
  LocalPeer peer;
  ucred credentials{};
  socklen_t size = sizeof(credentials);
  if (::getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &credentials, &size) == 0) {
    peer.uid = credentials.uid, peer.gid = credentials.gid, peer.pid = credentials.pid;
  } else {
    peer.uid = static_cast<uid_t>(-1), peer.gid = static_cast<gid_t>(-1);
  }
  gid_t groups[256];
  size = sizeof(groups);
  if (::getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, groups, &size) == 0) {
    peer.groups.assign(groups, groups + size / sizeof(gid_t));
  }
  return peer;
}

std::string AddressText(const sockaddr_storage& address, socklen_t size, bool port) {
  char host[INET6_ADDRSTRLEN] = "?", service[8] = "?";
  ::getnameinfo(reinterpret_cast<const sockaddr*>(&address), size, host, sizeof(host), service,
                sizeof(service), NI_NUMERICHOST | NI_NUMERICSERV);
  const bool six = address.ss_family == AF_INET6;
  std::string text = six ? fmt::format("[{}]", host) : host;
  return port ? fmt::format("{}:{}", text, service) : text;
}

ino_t InodeOf(int fd) {
  struct stat status {};
  return ::fstat(fd, &status) == 0 ? status.st_ino : 0;
}

StatusOr<int> BindTcp(const addrinfo& where, const std::string& host_port) {
  const int fd = ::socket(where.ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return Unavailable("{}: no socket: {}", host_port, std::strerror(errno));
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  if (::bind(fd, where.ai_addr, where.ai_addrlen) == 0 && ::listen(fd, kBacklog) == 0) return fd;
  const Status status =
      FailedPrecondition("{}: cannot be listened on: {}", host_port, std::strerror(errno));
  ::close(fd);
  return status;
}

}  // namespace

std::string UserName(uid_t uid) {
  passwd entry{};
  passwd* found = nullptr;
  std::vector<char> buffer(16384);
  if (::getpwuid_r(uid, &entry, buffer.data(), buffer.size(), &found) == 0 && found != nullptr) {
    return entry.pw_name;
  }
  return fmt::format("uid {}", uid);
}

StatusOr<gid_t> GroupNamed(const std::string& name) {
  group entry{};
  group* found = nullptr;
  std::vector<char> buffer(65536);
  if (::getgrnam_r(name.c_str(), &entry, buffer.data(), buffer.size(), &found) == 0 &&
      found != nullptr) {
    return entry.gr_gid;
  }
  return NotFound("group \"{}\": this machine has none of that name", name);
}

Listeners::Listeners(ListenerLimits limits) : limits_(limits) {}
Listeners::~Listeners() { Stop(); }

Status Listeners::AddUnix(const std::filesystem::path& path, mode_t mode,
                          std::optional<gid_t> group, Take take) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.string().size() >= sizeof(address.sun_path)) {
    return InvalidArgument("{}: longer than the {} bytes of a socket's path", path.string(),
                           sizeof(address.sun_path) - 1);
  }
  std::memcpy(address.sun_path, path.c_str(), path.string().size());
  ::unlink(path.c_str());
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return Unavailable("{}: no socket: {}", path.string(), std::strerror(errno));
  // Before bind: the file never has a wider mode. The group comes before what it may do.
  bool made = ::fchmod(fd, S_IRUSR | S_IWUSR) == 0 &&
              ::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0;
  if (made && group) made = ::chown(path.c_str(), static_cast<uid_t>(-1), *group) == 0;
  made = made && ::chmod(path.c_str(), mode) == 0 && ::listen(fd, kBacklog) == 0;
  if (!made) {
    const Status status =
        FailedPrecondition("{}: cannot be listened on with mode {:o}{}: {}", path.string(), mode,
                           group ? " and its group" : "", std::strerror(errno));
    ::close(fd);
    return status;
  }
  listeners_.push_back({fd, true, std::move(take)});
  return OkStatus();
}

StatusOr<std::string> Listeners::AddTcp(const std::string& host_port, Take take) {
  const size_t colon = host_port.rfind(':');
  if (colon == std::string::npos || colon == 0 || colon + 1 == host_port.size()) {
    return InvalidArgument("\"{}\" is not HOST:PORT", host_port);
  }
  std::string host = host_port.substr(0, colon);
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') {
    host = host.substr(1, host.size() - 2);
  }
  addrinfo hints{}, *found = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE;
  if (const int error = ::getaddrinfo(host.c_str(), host_port.c_str() + colon + 1, &hints, &found);
      error != 0) {
    return InvalidArgument("\"{}\": {}", host_port, ::gai_strerror(error));
  }
  const auto fd = BindTcp(*found, host_port);
  ::freeaddrinfo(found);
  if (!fd.ok()) return fd.status();
  listeners_.push_back({*fd, false, std::move(take)});
  sockaddr_storage bound{};
  socklen_t size = sizeof(bound);
  ::getsockname(*fd, reinterpret_cast<sockaddr*>(&bound), &size);
  return AddressText(bound, size, true);
}

void Listeners::Start() {
  if (::pipe2(wake_, O_CLOEXEC) != 0) return;  // (no descriptors: nothing else works either)
  thread_ = std::thread([this] {
    ::pthread_setname_np(::pthread_self(), "listeners");
    Run();
  });
}

void Listeners::Stop() {
  if (thread_.joinable()) {
    ::close(wake_[1]);
    thread_.join();
    ::close(wake_[0]);
  }
  for (const Listener& listener : listeners_) ::close(listener.fd);
  listeners_.clear();
}

void Listeners::Run() {
  std::vector<pollfd> polled;
  for (const Listener& listener : listeners_) polled.push_back({listener.fd, POLLIN, 0});
  polled.push_back({wake_[0], 0, 0});
  for (;;) {
    if (::poll(polled.data(), polled.size(), -1) < 0 && errno != EINTR) return;
    if (polled.back().revents != 0) return;
    for (size_t i = 0; i < listeners_.size(); ++i) {
      if (polled[i].revents != 0) Accept(listeners_[i]);
    }
  }
}

void Listeners::Accept(const Listener& listener) {
  sockaddr_storage address{};
  socklen_t size = sizeof(address);
  const int fd = ::accept4(listener.fd, reinterpret_cast<sockaddr*>(&address), &size,
                           SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (fd < 0) {
    // It stays readable: without a rest this thread would spin.
    if (errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS) {
      Log("access").error("no connection can be taken: {}", std::strerror(errno));
      pollfd wake{wake_[0], 0, 0};
      ::poll(&wake, 1, kExhausted_ms);
    }
    return;
  }
  Connection connection{listener.fd, fd, "", std::nullopt};
  std::string who;
  if (listener.local) {
    connection.local = PeerOf(fd);
    who = connection.from = fmt::format("uid {}", connection.local->uid);
  } else {
    const int on = 1;
    ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    connection.from = AddressText(address, size, true);
    who = AddressText(address, size, false);
  }
  if (const std::string reason = WhyNot(who); !reason.empty()) {
    return Refuse(connection, reason);
  }
  open_.push_back({fd, InodeOf(fd), std::move(who)});
  listener.take(std::move(connection));
}

void Listeners::Refuse(const Connection& connection, std::string_view reason) {
  ::close(connection.fd);
  ++untold_;
  const auto now = std::chrono::steady_clock::now();
  if (now - told_ < kBetweenLines) return;
  Log("access").warn("connection from {} refused: {} ({} since the last such line)",
                     connection.from, reason, untold_);
  told_ = now;
  untold_ = 0;
}

std::string Listeners::WhyNot(const std::string& who) {
  std::erase_if(open_, [](const Open& open) { return InodeOf(open.fd) != open.inode; });
  if (open_.size() >= limits_.connections) {
    return fmt::format("{} connections are open, the most that are taken", open_.size());
  }
  const auto same = static_cast<size_t>(
      std::count_if(open_.begin(), open_.end(), [&](const Open& o) { return o.who == who; }));
  if (same < limits_.connections_from_one) return {};
  return fmt::format("it has {} connections, the most that one may have", same);
}

}  // namespace mesorig::wire
