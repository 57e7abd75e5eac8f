#include "protocol/base/file_writer.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <fstream>

namespace mesorig {
namespace {

Status SyncPath(const std::filesystem::path& path, int flags) {
  const int fd = ::open(path.c_str(), flags | O_CLOEXEC);
  if (fd < 0) return Unavailable("{}: cannot open to sync: {}", path.string(), strerror(errno));
  const int result = ::fsync(fd);
  const int error = errno;
  ::close(fd);
  if (result != 0) return Unavailable("{}: fsync: {}", path.string(), strerror(error));
  return OkStatus();
}

std::filesystem::path FolderOf(const std::filesystem::path& path) {
  const auto parent = path.parent_path();
  return parent.empty() ? std::filesystem::path(".") : parent;
}

}  // namespace

StatusOr<AtomicFile> AtomicFile::Create(const std::filesystem::path& path) {
  static std::atomic<unsigned> counter{0};
  std::error_code ignored;
  if (!std::filesystem::is_directory(FolderOf(path), ignored)) {
    return InvalidArgument("{}: the folder does not exist", FolderOf(path).string());
  }
  if (std::filesystem::is_directory(path, ignored)) {
    return InvalidArgument("{}: is a folder, not a file", path.string());
  }
  auto temporary = FolderOf(path) / fmt::format(".{}.{}.{}.part", path.filename().string(),
                                                ::getpid(), counter++);
  const int fd = ::open(temporary.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0644);
  if (fd < 0) {
    return InvalidArgument("{}: cannot be written: {}", path.string(), strerror(errno));
  }
  ::close(fd);
  return AtomicFile(path, std::move(temporary));
}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : path_(std::move(other.path_)), temporary_(std::move(other.temporary_)) {
  other.temporary_.clear();
}

AtomicFile::~AtomicFile() {
  std::error_code ignored;
  if (!temporary_.empty()) std::filesystem::remove(temporary_, ignored);
}

Status AtomicFile::Commit() {
  MESORIG_RETURN_IF_ERROR(SyncPath(temporary_, O_RDONLY));
  std::error_code error;
  std::filesystem::rename(temporary_, path_, error);
  if (error) return Unavailable("{}: rename: {}", path_.string(), error.message());
  temporary_.clear();
  return SyncPath(FolderOf(path_), O_RDONLY | O_DIRECTORY);
}

Status WriteFileAtomically(const std::filesystem::path& path, std::string_view bytes) {
  MESORIG_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
  {
    std::ofstream out(file.temporary_path(), std::ios::binary);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    out.flush();
    if (!out) return Unavailable("{}: writing {} bytes failed", path.string(), bytes.size());
  }
  return file.Commit();
}

StatusOr<std::string> ReadFile(const std::filesystem::path& path, size_t max_bytes) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return NotFound("{}: no such file", path.string());
  if (!std::filesystem::is_regular_file(path, error)) {
    return InvalidArgument("{}: is not a file", path.string());
  }
  const auto size = std::filesystem::file_size(path, error);
  if (error) return InvalidArgument("{}: {}", path.string(), error.message());
  if (size > max_bytes) {
    return InvalidArgument("{}: {} bytes, at most {} are read", path.string(), size, max_bytes);
  }
  std::ifstream in(path, std::ios::binary);
  std::string bytes(size, '\0');
  in.read(bytes.data(), static_cast<std::streamsize>(size));
  if (!in) return InvalidArgument("{}: cannot be read", path.string());
  return bytes;
}

}  // namespace mesorig
