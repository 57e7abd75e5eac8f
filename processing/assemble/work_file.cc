#include "processing/assemble/work_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace mesorig::assemble {

StatusOr<WorkFile> WorkFile::Create(const std::filesystem::path& path, size_t slots,
                                    size_t floats_per_slot) {
  WorkFile file;
  const size_t bytes = slots * floats_per_slot * sizeof(float);
  if (bytes == 0) return InvalidArgument("{}: a work file without slots", path.string());
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (fd < 0) return InvalidArgument("cannot create {}: {}", path.string(), std::strerror(errno));
  file.path_ = path;  // removed from here on, whatever happens
  // Reserved now: a mapped file that runs out of disk later kills the process.
  const int error = ::posix_fallocate(fd, 0, static_cast<off_t>(bytes));
  void* data = MAP_FAILED;
  if (error == 0) data = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  const int map_error = errno;
  ::close(fd);
  if (data == MAP_FAILED) {
    return FailedPrecondition("{}: cannot reserve {} bytes: {}", path.string(), bytes,
                              std::strerror(error != 0 ? error : map_error));
  }
  file.data_ = static_cast<float*>(data);
  file.bytes_ = bytes;
  file.floats_per_slot_ = floats_per_slot;
  return file;
}

WorkFile::WorkFile(WorkFile&& other) noexcept
    : path_(std::exchange(other.path_, {})),
      data_(std::exchange(other.data_, nullptr)),
      bytes_(other.bytes_),
      floats_per_slot_(other.floats_per_slot_) {}

WorkFile::~WorkFile() {
  if (data_ != nullptr) ::munmap(data_, bytes_);
  std::error_code ignored;
  if (!path_.empty()) std::filesystem::remove(path_, ignored);
}

}  // namespace mesorig::assemble
