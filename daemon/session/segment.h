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
#include "protocol/base/disk_faults.h"
#include "protocol/base/status.h"
#include "protocol/base/unique_fd.h"

namespace mesorig::daemon {

inline constexpr uint32_t kSegmentVersion = 1;
inline constexpr size_t kRecordHeaderBytes = 72;
inline constexpr size_t kMaxFrameBytes = size_t{1} << 30;

// Owned and called by one thread (the session's writer). Unavailable names the file, the operation
// and why; what failed may be tried again.
class SegmentWriter {
 public:
  // Opens the file to go on at `end`, where the last record that counts ends; 0: none does. Creates
  // it when it is not there, writes its header when it has none, cuts off what lies beyond the end.
  // Nothing of it is synced yet. `faults`: may be null; borrowed.
  static StatusOr<SegmentWriter> Open(const std::filesystem::path& path, int camera,
                                      std::string_view camera_name, uint64_t end,
                                      DiskFaults* faults = nullptr);
  // Writes record header and pixels; returns the record's offset. After an error the file may end
  // in a torn record, which the next one overwrites.
  StatusOr<uint64_t> Append(uint64_t sequence, uint32_t shot, std::string_view digest,
                            std::string_view pixels);
  // fdatasync. After an error nobody knows what is on the disk: everything since the last sync must
  // be written again.
  Status Sync();
  uint64_t end() const { return end_; }
  // The next record goes there.
  void Rewind(uint64_t end) { end_ = writeback_end_ = end; }
  // Open created it: its folder must be synced too.
  bool is_new() const { return is_new_; }

 private:
  SegmentWriter(std::filesystem::path path, UniqueFd fd, bool is_new, DiskFaults* faults)
      : path_(std::move(path)), fd_(std::move(fd)), is_new_(is_new), faults_(faults) {}
  Status Write(std::string_view bytes, uint64_t offset);
  void StartWriteback();
  Status CutAt(uint64_t end);

  std::filesystem::path path_;
  UniqueFd fd_;
  bool is_new_;
  DiskFaults* faults_;
  uint64_t end_ = 0;
  uint64_t writeback_end_ = 0;  // the disk has been told to begin with what lies before
};

// Bytes from the outside, without a file. Of a file header (the first kilobytes of a segment):
// FailedPrecondition for the format of a newer program, DataLoss for a damaged one.
Status CheckSegmentHeader(std::string_view start);
// The record header at the beginning of `bytes` is this row's; DataLoss tells what is not.
Status CheckRecordHeader(std::string_view bytes, const FrameRecord& record);

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
