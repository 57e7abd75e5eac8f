#pragma once
// One camera's segment file: a file header, then one record a frame. docs/files.md tells every
// byte. The ledger says where each frame stands; what lies beyond the last ledger row is a torn
// tail and is ignored, and a damaged record costs that frame only.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "daemon/session/session.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// A file descriptor that closes itself.
class UniqueFd {
 public:
  explicit UniqueFd(int fd = -1) : fd_(fd) {}
  UniqueFd(UniqueFd&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  UniqueFd& operator=(UniqueFd&& other) noexcept;
  ~UniqueFd();
  int get() const { return fd_; }

 private:
  int fd_ = -1;
};

inline constexpr uint32_t kSegmentVersion = 1;
inline constexpr size_t kRecordHeaderBytes = 72;
inline constexpr size_t kMaxFrameBytes = size_t{1} << 30;

// Owned and called by one thread (the session's writer).
class SegmentWriter {
 public:
  // A new file with its header, not yet synced. Unavailable names the file and what failed.
  static StatusOr<SegmentWriter> Create(const std::filesystem::path& path, int camera,
                                        std::string_view camera_name);
  // Goes on at the end of a file that Create wrote.
  static StatusOr<SegmentWriter> OpenAtEnd(const std::filesystem::path& path);
  // Writes record header and pixels; returns the record's offset. After an error the file may end
  // in a torn record: the writer is then of no further use.
  StatusOr<uint64_t> Append(uint64_t sequence, uint32_t shot, std::string_view digest,
                            std::string_view pixels);
  // fdatasync.
  Status Sync();

 private:
  SegmentWriter(std::filesystem::path path, UniqueFd fd, uint64_t end)
      : path_(std::move(path)), fd_(std::move(fd)), end_(end) {}
  Status Write(std::string_view bytes, uint64_t offset);

  std::filesystem::path path_;
  UniqueFd fd_;
  uint64_t end_ = 0;
};

// Any thread; immutable after Open.
class SegmentReader {
 public:
  // NotFound without the file; FailedPrecondition for the format of a newer program. A damaged file
  // header is no error: the ledger knows where the frames are.
  static StatusOr<SegmentReader> Open(const std::filesystem::path& path);
  // The pixels of this ledger row. DataLoss names file, frame and what does not match.
  StatusOr<std::shared_ptr<const std::string>> Read(const FrameRecord& record) const;

 private:
  SegmentReader(std::filesystem::path path, UniqueFd fd)
      : path_(std::move(path)), fd_(std::move(fd)) {}
  std::filesystem::path path_;
  UniqueFd fd_;
};

}  // namespace mesorig::daemon
