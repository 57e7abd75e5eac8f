#include "daemon/service/audit_log.h"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <syslog.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>
#include <system_error>

#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

using Utc = std::chrono::system_clock::time_point;

std::string UtcText(Utc time) {
  const auto since = std::chrono::duration_cast<std::chrono::milliseconds>(time.time_since_epoch());
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03d}Z",
                     fmt::gmtime(std::chrono::system_clock::to_time_t(time)), since.count() % 1000);
}

// Escaped, in quotes, at most `limit` bytes of it; what is no UTF-8 is replaced.
std::string Json(std::string_view text, size_t limit = AuditLog::kMaxWhat) {
  return nlohmann::json(std::string(text.substr(0, limit)))
      .dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

Status DiskError(const std::filesystem::path& path, std::string_view doing, int error) {
  return Unavailable("{}: {}: {}", path.string(), doing, std::strerror(error));
}

AuditEntry OfDaemon(std::string_view call, std::string what, std::string outcome = "OK") {
  AuditEntry entry;
  entry.caller.name = "mesorigd";
  entry.call = call;
  entry.what = std::move(what);
  entry.outcome = std::move(outcome);
  return entry;
}

// Puts a file that was tampered with aside. Says what was wrong.
StatusOr<std::string> PutAside(const std::filesystem::path& path, const ChainReport& report,
                               Utc now) {
  const auto aside =
      std::filesystem::path(fmt::format("{}.damaged-{:%Y%m%dT%H%M%S}", path.string(),
                                        fmt::gmtime(std::chrono::system_clock::to_time_t(now))));
  std::error_code error;
  if (std::filesystem::exists(aside, error)) {
    return Unavailable("{}: is there already", aside.string());
  }
  std::filesystem::rename(path, aside, error);
  if (error) return DiskError(path, "renaming", error.value());
  return fmt::format("the log before was tampered with: entry {} {}; it is {} now, good up to {}",
                     report.bad_entry, report.wrong, aside.filename().string(),
                     AnchorText(report.head));
}

}  // namespace

void SystemAnchor(std::string_view line) {
  ::syslog(LOG_AUTHPRIV | LOG_NOTICE, "%.*s", static_cast<int>(line.size()), line.data());
}

StatusOr<std::unique_ptr<AuditLog>> AuditLog::Open(const std::filesystem::path& state_dir,
                                                   AuditOptions options) {
  std::error_code error;
  std::filesystem::create_directories(state_dir, error);
  if (error) return DiskError(state_dir, "making the folder", error.value());
  const auto path = state_dir / kAuditFile;
  ChainReport report;
  auto verified = VerifyChainFile(path);
  if (verified.ok()) {
    report = *std::move(verified);
  } else if (!absl::IsNotFound(verified.status())) {
    return verified.status();
  }
  std::string found = fmt::format("{} entries", report.head.sequence);
  if (report.bad_entry != 0) {
    MESORIG_ASSIGN_OR_RETURN(found, PutAside(path, report, options.utc()));
    Log("audit").critical("{}", found);
    report = {};
  } else if (report.torn_bytes > 0) {
    found += fmt::format("; the beginning of one, {} bytes, was dropped", report.torn_bytes);
  }
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0640);
  if (file < 0) return DiskError(path, "opening", errno);
  if (::ftruncate(file, static_cast<off_t>(report.bytes)) != 0) {
    const int why = errno;
    ::close(file);
    return DiskError(path, "cutting off what a kill left", why);
  }
  std::unique_ptr<AuditLog> log(new AuditLog(file, path, std::move(report), std::move(options)));
  MESORIG_RETURN_IF_ERROR(log->Record(OfDaemon("daemon/opened", std::move(found))));
  log->Anchor();
  return log;
}

AuditLog::AuditLog(int file, std::filesystem::path path, ChainReport report, AuditOptions options)
    : file_(file), path_(std::move(path)), options_(std::move(options)) {
  {
    const MutexLock lock(mutex_);
    head_ = report.head;
    bytes_ = report.bytes;
  }
  anchored_ = report.head.sequence;
  writer_ = std::thread([this] { Loop(); });
}

AuditLog::~AuditLog() {
  RecordLater(OfDaemon("daemon/closed", ""));
  {
    const MutexLock lock(mutex_);
    ending_ = anchor_asked_ = true;
    changed_.NotifyAll();
  }
  writer_.join();
  ::close(file_);
}

std::string AuditLog::Fields(const AuditEntry& entry) const {
  return fmt::format(
      "\"utc\":\"{}\",\"rig_s\":{:.6f},\"name\":{},\"role\":{},\"peer\":{},\"via\":{},\"call\":{},"
      "\"what\":{},\"outcome\":{}",
      UtcText(options_.utc()), options_.rig_s(), Json(entry.caller.name, 256),
      Json(Name(entry.caller.role)), Json(entry.caller.peer, 256), Json(entry.caller.via, 256),
      Json(entry.call, 256), Json(entry.what), Json(entry.outcome));
}

uint64_t AuditLog::Enqueue(std::string fields) {
  if (waiting_.size() >= options_.waiting_limit) {
    ++lost_;
    return 0;
  }
  if (lost_ > 0) {
    waiting_.push_back(Fields(OfDaemon("daemon/lost", fmt::format("{} entries", lost_),
                                       "memory was full while the disk took nothing")));
    ++enqueued_;
    lost_ = 0;
  }
  waiting_.push_back(std::move(fields));
  changed_.NotifyAll();
  return ++enqueued_;
}

Status AuditLog::Record(AuditEntry entry) {
  std::string fields = Fields(entry);
  const MutexLock lock(mutex_);
  const uint64_t failures = failures_;
  const uint64_t number = Enqueue(std::move(fields));
  if (number == 0) return health_;
  while (written_ < number && failures_ == failures) changed_.Wait(mutex_);
  return written_ >= number ? OkStatus() : health_;
}

void AuditLog::RecordLater(AuditEntry entry) {
  std::string fields = Fields(entry);
  const MutexLock lock(mutex_);
  Enqueue(std::move(fields));
}

void AuditLog::Anchor() {
  const MutexLock lock(mutex_);
  anchor_asked_ = true;
  changed_.NotifyAll();
}

ChainHead AuditLog::head() const {
  const MutexLock lock(mutex_);
  return head_;
}

Status AuditLog::health() const {
  const MutexLock lock(mutex_);
  return health_;
}

StatusOr<std::string> AuditLog::Read(uint64_t offset, size_t limit) const {
  uint64_t bytes = 0;
  {
    const MutexLock lock(mutex_);
    bytes = bytes_;
  }
  if (offset >= bytes) return std::string();
  std::string text(std::min<uint64_t>(limit, bytes - offset), '\0');
  const int file = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return DiskError(path_, "opening", errno);
  const ssize_t read = ::pread(file, text.data(), text.size(), static_cast<off_t>(offset));
  const int why = errno;
  ::close(file);
  if (read < 0) return DiskError(path_, "reading", why);
  text.resize(static_cast<size_t>(read));
  return text;
}

Status AuditLog::Write(const std::string& lines, uint64_t at) {
  uint64_t torn = 0;
  size_t size = lines.size();
  int error = 0;
  if (options_.faults != nullptr) {
    error = options_.faults->Before({DiskOperation::kWrite, path_, at, size}, &torn);
    if (error != 0) size = torn;
  }
  for (size_t done = 0; done < size;) {
    const ssize_t n =
        ::pwrite(file_, lines.data() + done, size - done, static_cast<off_t>(at + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      error = n < 0 ? errno : EIO;
      break;
    }
    done += static_cast<size_t>(n);
  }
  if (error != 0) return DiskError(path_, "writing", error);
  error = AskDisk(options_.faults, DiskOperation::kSync, path_);
  if (error == 0 && ::fdatasync(file_) != 0) error = errno;
  return error == 0 ? OkStatus() : DiskError(path_, "syncing", error);
}

bool AuditLog::WriteBatch(std::deque<std::string>& batch) {
  ChainHead head;
  uint64_t at = 0;
  {
    const MutexLock lock(mutex_);
    head = head_;
    at = bytes_;
  }
  std::string lines;
  for (const std::string& fields : batch) lines += AppendToChain(head, fields);
  Status status = Write(lines, at);
  if (!status.ok() && ::ftruncate(file_, static_cast<off_t>(at)) != 0) {
    Log("audit").error("{}: cutting off half an entry: {}", path_.string(), std::strerror(errno));
  }
  const bool ok = status.ok();
  {
    const MutexLock lock(mutex_);
    if (health_.ok() && !ok) Log("audit").error("{}", Message(status));
    health_ = std::move(status);
    if (ok) {
      head_ = head;
      bytes_ = at + lines.size();
      written_ += batch.size();
    } else {
      ++failures_;
      waiting_.insert(waiting_.begin(), batch.begin(), batch.end());
    }
    changed_.NotifyAll();
  }
  batch.clear();
  return ok;
}

void AuditLog::TellAnchor(const ChainHead& head) {
  if (anchored_ == head.sequence) return;
  anchored_ = head.sequence;
  const std::string line = AnchorText(head);
  Log("audit").info("{}", line);
  if (options_.anchor) {
    options_.anchor(line);
  } else {
    SystemAnchor(line);
  }
}

void AuditLog::Loop() {
  for (;;) {
    std::deque<std::string> batch;
    bool anchor = false, ending = false;
    {
      const MutexLock lock(mutex_);
      while (waiting_.empty() && !anchor_asked_ && !ending_) changed_.Wait(mutex_);
      batch.swap(waiting_);
      anchor = std::exchange(anchor_asked_, false);
      ending = ending_;
    }
    const bool written = batch.empty() || WriteBatch(batch);
    if (written) {
      const ChainHead now = head();
      if (anchor || now.sequence >= anchored_ + options_.anchor_every) TellAnchor(now);
    }
    const MutexLock lock(mutex_);
    if (!written && anchor) anchor_asked_ = true;
    if (ending && (!written || waiting_.empty())) return;
    if (!written && !ending_) changed_.WaitFor(mutex_, options_.retry);
  }
}

}  // namespace mesorig::daemon
