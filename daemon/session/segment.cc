#include "daemon/session/segment.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "protocol/base/bytes.h"
#include "protocol/base/digest.h"

namespace mesorig::daemon {
namespace {

constexpr std::string_view kFileMagic = "mesoseg\n";
constexpr uint32_t kRecordMagic = 0x314D5246;  // "FRM1"
constexpr size_t kCheckBytes = 16;             // of a header: the first half of its digest
constexpr size_t kMaxFileHeader = 4096;
constexpr size_t kWritebackBytes = 512 << 10;  // less is not worth a request of its own

// Appends the check of everything before it.
std::string WithCheck(std::string header) {
  header += FrameDigest(header).substr(0, kCheckBytes);
  return header;
}

bool CheckHolds(std::string_view header) {
  if (header.size() < kCheckBytes) return false;
  const std::string_view body = header.substr(0, header.size() - kCheckBytes);
  return FrameDigest(body).substr(0, kCheckBytes) == header.substr(body.size());
}

std::string FileHeader(int camera, std::string_view camera_name) {
  ByteWriter out;
  out.PutRaw(kFileMagic).Put(kSegmentVersion);
  out.Put(static_cast<uint32_t>(kFileMagic.size() + 16 + camera_name.size() + kCheckBytes));
  out.Put(static_cast<uint32_t>(camera)).PutString(camera_name);
  return WithCheck(out.Take());
}

std::string RecordHeader(uint64_t sequence, uint32_t shot, std::string_view digest, size_t bytes) {
  ByteWriter out;
  out.Put(kRecordMagic).Put(sequence).Put(shot).Put(static_cast<uint64_t>(bytes)).PutRaw(digest);
  return WithCheck(out.Take());
}

// Reads up to bytes.size(); fewer at the end of the file.
StatusOr<size_t> ReadAt(int fd, const std::filesystem::path& path, uint64_t offset,
                        std::string& bytes) {
  size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n =
        ::pread(fd, bytes.data() + done, bytes.size() - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) {
      return Unavailable("{}: reading {} bytes at {}: {}", path.string(), bytes.size(), offset,
                         strerror(errno));
    }
    if (n == 0) break;
    done += static_cast<size_t>(n);
  }
  return done;
}

}  // namespace

StatusOr<SegmentWriter> SegmentWriter::Open(const std::filesystem::path& path, int camera,
                                            std::string_view camera_name, uint64_t end,
                                            DiskFaults* faults) {
  UniqueFd fd(::open(path.c_str(), O_RDWR | O_CLOEXEC));
  const bool is_new = fd.get() < 0 && errno == ENOENT;
  if (is_new) {
    int error = AskDisk(faults, DiskOperation::kCreate, path);
    if (error == 0) {
      fd = UniqueFd(::open(path.c_str(), O_CREAT | O_EXCL | O_RDWR | O_CLOEXEC, 0644));
      error = errno;
    }
    if (fd.get() < 0)
      return Unavailable("{}: cannot be created: {}", path.string(), strerror(error));
  }
  struct stat info {};
  if (fd.get() < 0 || ::fstat(fd.get(), &info) != 0) {
    return Unavailable("{}: cannot be opened for writing: {}", path.string(), strerror(errno));
  }
  SegmentWriter writer(path, std::move(fd), is_new, faults);
  const std::string header = FileHeader(camera, camera_name);
  const auto size = static_cast<uint64_t>(info.st_size);
  writer.Rewind(std::max<uint64_t>(end, header.size()));
  if (size > writer.end_) MESORIG_RETURN_IF_ERROR(writer.CutAt(writer.end_));
  // (The header of a file with records is left as it is: the ledger knows where they are.)
  if (size < header.size() || (end == 0 && size > header.size())) {
    MESORIG_RETURN_IF_ERROR(writer.Write(header, 0));
  }
  return writer;
}

Status SegmentWriter::CutAt(uint64_t end) {
  int error = AskDisk(faults_, DiskOperation::kTruncate, path_, end);
  if (error == 0 && ::ftruncate(fd_.get(), static_cast<off_t>(end)) != 0) error = errno;
  if (error == 0) return OkStatus();
  return Unavailable("{}: cutting it at {} bytes: {}", path_.string(), end, strerror(error));
}

Status SegmentWriter::Write(std::string_view bytes, uint64_t offset) {
  const std::string_view all = bytes;
  uint64_t torn = 0;
  const int refused =
      faults_ == nullptr
          ? 0
          : faults_->Before({DiskOperation::kWrite, path_, offset, bytes.size()}, &torn);
  if (refused != 0) bytes = bytes.substr(0, torn);
  size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = ::pwrite(fd_.get(), bytes.data() + done, bytes.size() - done,
                               static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      return Unavailable("{}: writing {} bytes at {}: {}", path_.string(), all.size(), offset,
                         n < 0 ? strerror(errno) : "nothing was written");
    }
    done += static_cast<size_t>(n);
  }
  if (refused == 0) return OkStatus();
  return Unavailable("{}: writing {} bytes at {}: {}", path_.string(), all.size(), offset,
                     strerror(refused));
}

StatusOr<uint64_t> SegmentWriter::Append(uint64_t sequence, uint32_t shot, std::string_view digest,
                                         std::string_view pixels) {
  const uint64_t offset = end_;
  const std::string header = RecordHeader(sequence, shot, digest, pixels.size());
  MESORIG_RETURN_IF_ERROR(Write(header, offset));
  MESORIG_RETURN_IF_ERROR(Write(pixels, offset + header.size()));
  end_ = offset + header.size() + pixels.size();
  StartWriteback();
  return offset;
}

// The disk works while the next frames are digested and copied, and a sync finds little left to do.
// Only a hint: what goes wrong is told by the sync.
void SegmentWriter::StartWriteback() {
  if (end_ - writeback_end_ < kWritebackBytes) return;
  (void)::sync_file_range(fd_.get(), static_cast<off_t>(writeback_end_),
                          static_cast<off_t>(end_ - writeback_end_), SYNC_FILE_RANGE_WRITE);
  writeback_end_ = end_;
}

Status SegmentWriter::Sync() {
  int error = AskDisk(faults_, DiskOperation::kSync, path_);
  if (error == 0 && ::fdatasync(fd_.get()) != 0) error = errno;
  if (error != 0) {
    return Unavailable("{}: fdatasync of {} bytes: {}", path_.string(), end_, strerror(error));
  }
  return OkStatus();
}

Status CheckSegmentHeader(std::string_view start) {
  ByteReader in(start);
  const std::string_view magic = in.GetRaw(kFileMagic.size());
  const auto version = in.Get<uint32_t>(), size = in.Get<uint32_t>();
  if (!in.ok() || magic != kFileMagic || size > start.size() ||
      !CheckHolds(start.substr(0, size))) {
    return DataLoss("the segment's header is damaged");
  }
  if (version > kSegmentVersion) {
    return FailedPrecondition("segment version {}, this program reads up to {}", version,
                              kSegmentVersion);
  }
  return OkStatus();
}

Status CheckRecordHeader(std::string_view bytes, const FrameRecord& record) {
  const std::string_view header = bytes.substr(0, kRecordHeaderBytes);
  if (header.size() != kRecordHeaderBytes || !CheckHolds(header)) {
    return DataLoss("record header is damaged");
  }
  if (header != RecordHeader(record.sequence, record.shot, record.digest, record.bytes)) {
    return DataLoss("record header is another frame's");
  }
  return OkStatus();
}

StatusOr<SegmentReader> SegmentReader::Open(const std::filesystem::path& path) {
  UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (fd.get() < 0) return NotFound("{}: cannot be opened: {}", path.string(), strerror(errno));
  std::string start(kMaxFileHeader, '\0');
  MESORIG_ASSIGN_OR_RETURN(const size_t got, ReadAt(fd.get(), path, 0, start));
  start.resize(got);
  const Status status = CheckSegmentHeader(start);
  if (absl::IsFailedPrecondition(status)) return Annotate(status, path.string());
  return SegmentReader(path, std::move(fd));
}

StatusOr<std::shared_ptr<const std::string>> SegmentReader::Read(const FrameRecord& record) const {
  const auto damaged = [&](std::string_view what) {
    return DataLoss("{}: frame {} (shot {}, at byte {}): {}", path_.string(), record.sequence,
                    record.shot, record.offset, what);
  };
  struct stat info {};
  if (::fstat(fd_.get(), &info) != 0) {
    return Unavailable("{}: fstat: {}", path_.string(), strerror(errno));
  }
  const auto file_bytes = static_cast<uint64_t>(info.st_size);
  // (Both tested apart: their sum could wrap.)
  if (record.bytes > kMaxFrameBytes || record.offset > file_bytes ||
      record.bytes + kRecordHeaderBytes > file_bytes - record.offset) {
    return damaged(fmt::format("ends beyond the file's {} bytes", file_bytes));
  }
  std::string header(kRecordHeaderBytes, '\0');
  MESORIG_ASSIGN_OR_RETURN(size_t got, ReadAt(fd_.get(), path_, record.offset, header));
  header.resize(got);
  const Status whole = CheckRecordHeader(header, record);
  if (!whole.ok()) return damaged(Message(whole));
  auto pixels = std::make_shared<std::string>(record.bytes, '\0');
  MESORIG_ASSIGN_OR_RETURN(got,
                           ReadAt(fd_.get(), path_, record.offset + kRecordHeaderBytes, *pixels));
  if (got != pixels->size()) return damaged(fmt::format("only {} bytes are left", got));
  if (FrameDigest(*pixels) != record.digest) return damaged("pixels do not match their digest");
  return pixels;
}

}  // namespace mesorig::daemon
