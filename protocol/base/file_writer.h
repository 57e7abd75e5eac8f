#pragma once
// Files that are whole or absent: written under a temporary name in the same folder, synced,
// renamed. Library writers (OpenEXR, PNG) write to `AtomicFile::temporary_path()`.

#include <filesystem>
#include <string>
#include <string_view>

#include "protocol/base/status.h"

namespace mesorig {

// Owns the temporary file: without Commit the destructor removes it. Not thread-safe.
class AtomicFile {
 public:
  // Fails (InvalidArgument) when the folder of `path` does not exist or cannot be written.
  static StatusOr<AtomicFile> Create(const std::filesystem::path& path);
  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();
  const std::filesystem::path& temporary_path() const { return temporary_; }
  // fsync, rename onto the final name, fsync of the folder.
  Status Commit();

 private:
  AtomicFile(std::filesystem::path path, std::filesystem::path temporary)
      : path_(std::move(path)), temporary_(std::move(temporary)) {}
  std::filesystem::path path_, temporary_;
};

Status WriteFileAtomically(const std::filesystem::path& path, std::string_view bytes);

// The whole file; NotFound or InvalidArgument names it. Refuses more than `max_bytes`.
StatusOr<std::string> ReadFile(const std::filesystem::path& path, size_t max_bytes = 64u << 20);

}  // namespace mesorig
