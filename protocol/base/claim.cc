#include "protocol/base/claim.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

namespace mesorig {

StatusOr<FileClaim> FileClaim::Take(const std::filesystem::path& file, std::string_view taken) {
  const int fd = ::open(file.c_str(), O_CREAT | O_RDWR | O_CLOEXEC | O_NOFOLLOW, 0644);
  if (fd < 0) return InvalidArgument("{}: cannot be opened: {}", file.string(), std::strerror(errno));
  FileClaim claim(fd);
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    char owner[32] = {};
    const ssize_t n = ::pread(fd, owner, sizeof(owner) - 1, 0);
    return FailedPrecondition("{} (process {})", taken, n > 0 ? owner : "?");
  }
  const std::string pid = std::to_string(::getpid());
  if (::ftruncate(fd, 0) != 0 || ::pwrite(fd, pid.data(), pid.size(), 0) < 0) {
    return Unavailable("{}: cannot be written: {}", file.string(), std::strerror(errno));
  }
  return claim;
}

FileClaim::FileClaim(FileClaim&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }

FileClaim::~FileClaim() {
  if (fd_ >= 0) ::close(fd_);
}

}  // namespace mesorig
