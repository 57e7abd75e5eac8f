#include "protocol/base/runtime_dir.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdlib>

#include "protocol/base/file_writer.h"

namespace mesorig {
namespace {

constexpr size_t kMaxSocketPath = 107;

std::filesystem::path EndpointFile(const std::filesystem::path& dir, std::string_view name) {
  return dir / fmt::format("{}.endpoint", name);
}

}  // namespace

std::filesystem::path DefaultRuntimeDir() {
  if (const char* dir = std::getenv("MESORIG_RUNTIME_DIR"); dir != nullptr && *dir != 0) return dir;
  if (const char* dir = std::getenv("XDG_RUNTIME_DIR"); dir != nullptr && *dir != 0) {
    return std::filesystem::path(dir) / "mesorig";
  }
  return fmt::format("/tmp/mesorig-{}", ::getuid());
}

StatusOr<PublishedEndpoint> PublishedEndpoint::Claim(const std::filesystem::path& dir,
                                                     std::string_view name) {
  std::error_code error;
  std::filesystem::create_directories(dir, error);
  if (error) return InvalidArgument("runtime directory {}: {}", dir.string(), error.message());
  const auto absolute = std::filesystem::absolute(dir, error);
  const auto socket = absolute / fmt::format("{}.sock", name);
  if (socket.string().size() > kMaxSocketPath) {
    return InvalidArgument("runtime directory {}: its socket paths exceed {} bytes; choose a shorter one",
                           absolute.string(), kMaxSocketPath);
  }
  const auto lock = absolute / fmt::format("{}.lock", name);
  const int fd = ::open(lock.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0644);
  if (fd < 0) return InvalidArgument("{}: cannot be opened: {}", lock.string(), strerror(errno));
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    char owner[32] = {};
    const ssize_t n = ::pread(fd, owner, sizeof(owner) - 1, 0);
    ::close(fd);
    return FailedPrecondition("{} already runs in {} (process {})", name, absolute.string(),
                              n > 0 ? owner : "?");
  }
  const std::string pid = std::to_string(::getpid());
  if (::ftruncate(fd, 0) != 0 || ::pwrite(fd, pid.data(), pid.size(), 0) < 0) {
    ::close(fd);
    return Unavailable("{}: cannot be written: {}", lock.string(), strerror(errno));
  }
  std::filesystem::remove(EndpointFile(absolute, name), error);
  std::filesystem::remove(socket, error);
  return PublishedEndpoint(absolute, std::string(name), fd);
}

PublishedEndpoint::PublishedEndpoint(PublishedEndpoint&& other) noexcept
    : dir_(std::move(other.dir_)), name_(std::move(other.name_)), lock_fd_(other.lock_fd_) {
  other.lock_fd_ = -1;
}

PublishedEndpoint::~PublishedEndpoint() {
  if (lock_fd_ < 0) return;
  std::error_code ignored;
  std::filesystem::remove(EndpointFile(dir_, name_), ignored);
  std::filesystem::remove(socket_path(), ignored);
  ::close(lock_fd_);  // gives the lock back; the lock file stays, so that nobody locks a ghost
}

std::filesystem::path PublishedEndpoint::socket_path() const {
  return dir_ / fmt::format("{}.sock", name_);
}

Status PublishedEndpoint::Publish(std::string_view endpoint) {
  return WriteFileAtomically(EndpointFile(dir_, name_), endpoint);
}

StatusOr<std::string> FindEndpoint(const std::filesystem::path& dir, std::string_view name) {
  const auto file = EndpointFile(dir, name);
  auto endpoint = ReadFile(file, 4096);
  if (!endpoint.ok()) {
    return Unavailable("{} is not running (no {})", name, file.string());
  }
  return endpoint;
}

}  // namespace mesorig
