#pragma once
// The certificates that may come in over the network, one a line of a file: the SHA-256 of the
// certificate, then whatever helps a reader (name, role, end). Taking the line away revokes it.
//
//   8d5f…c1 anna operator 2026-12-22
//
// Lines that begin with # and lines that name no fingerprint let nobody in.

#include <filesystem>
#include <set>
#include <string>
#include <string_view>

#include "protocol/base/mutex.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// Thread-safe. Looks at the file whenever it is asked, and reads it again when it changed. A file
// that is missing or cannot be read lets nobody in.
class AllowList {
 public:
  explicit AllowList(std::filesystem::path file) : file_(std::move(file)) {}
  bool Allows(std::string_view fingerprint);
  void Reload();  // whether it seems changed or not
  const std::filesystem::path& file() const { return file_; }

  static constexpr size_t kMaxBytes = 1u << 20;

 private:
  struct Stamp {
    int64_t seconds = -1, nanoseconds = 0;
    uint64_t inode = 0, size = 0;
    bool operator==(const Stamp&) const = default;
  };
  Stamp Look() const;
  void Read(const Stamp& stamp) REQUIRES(mutex_);

  const std::filesystem::path file_;
  Mutex mutex_;
  Stamp stamp_ GUARDED_BY(mutex_);
  std::set<std::string, std::less<>> fingerprints_ GUARDED_BY(mutex_);
};

// The fingerprints of such a file's text.
std::set<std::string, std::less<>> ReadAllowed(std::string_view text);

}  // namespace mesorig::daemon
