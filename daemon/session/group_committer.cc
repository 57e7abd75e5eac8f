#include "daemon/session/group_committer.h"

#include <pthread.h>

#include "protocol/base/digest.h"

namespace mesorig::daemon {

GroupCommitter::GroupCommitter(std::unique_ptr<Ledger> ledger, SegmentWriters segments,
                               size_t max_queued_bytes, OnCommit on_commit,
                               std::function<void(const Status&)> on_storage)
    : max_queued_bytes_(max_queued_bytes),
      on_commit_(std::move(on_commit)),
      on_storage_(std::move(on_storage)),
      ledger_(std::move(ledger)),
      segments_(std::move(segments)) {
  thread_ = std::thread([this] { Loop(); });
}

GroupCommitter::~GroupCommitter() {
  const Status ignored = Close();  // whoever wants to know calls Close
}

Status GroupCommitter::Append(FrameRecord record, std::shared_ptr<const std::string> pixels) {
  MutexLock lock(mutex_);
  const size_t bytes = pixels->size();
  // (A single frame larger than the limit must pass.)
  const auto is_full = [&]() REQUIRES(mutex_) {
    return error_.ok() && queued_bytes_ > 0 && queued_bytes_ + bytes > max_queued_bytes_;
  };
  ++blocked_;
  if (is_full()) changed_.NotifyAll();
  while (is_full() && trouble_.ok()) changed_.Wait(mutex_);
  --blocked_;
  MESORIG_RETURN_IF_ERROR(error_);
  if (is_full()) {
    return absl::ResourceExhaustedError(
        fmt::format("{}; no more than {} are kept: shot {} of camera {} is not",
                    Message(StorageLocked()), max_queued_bytes_, record.shot, record.camera));
  }
  queue_.push_back({std::move(record), std::move(pixels), {}});
  queued_bytes_ += bytes;
  ++appended_;
  changed_.NotifyAll();
  return OkStatus();
}

Status GroupCommitter::Record(JournalEntry entry) {
  MutexLock lock(mutex_);
  MESORIG_RETURN_IF_ERROR(error_);
  queue_.push_back({{}, nullptr, std::move(entry)});
  ++appended_;
  changed_.NotifyAll();
  return OkStatus();
}

Status GroupCommitter::Flush() {
  MutexLock lock(mutex_);
  const uint64_t upto = appended_;
  // (An attempt that is under way may have begun before what is flushed.)
  const uint64_t enough = failures_ + (trying_ ? 2 : 1);
  ++flushing_;
  retry_now_ = true;
  changed_.NotifyAll();
  while (error_.ok() && durable_ < upto && failures_ < enough) {
    retry_now_ = true;
    changed_.Wait(mutex_);
  }
  --flushing_;
  MESORIG_RETURN_IF_ERROR(error_);
  return durable_ < upto ? StorageLocked() : OkStatus();
}

Status GroupCommitter::Close() {
  {
    MutexLock lock(mutex_);
    closing_ = true;
    changed_.NotifyAll();
  }
  if (thread_.joinable()) thread_.join();
  MutexLock lock(mutex_);
  return error_.ok() ? StorageLocked() : error_;
}

Status GroupCommitter::Storage() const {
  MutexLock lock(mutex_);
  return error_.ok() ? StorageLocked() : error_;
}

Status GroupCommitter::StorageLocked() const {
  if (trouble_.ok()) return OkStatus();
  return Status(trouble_.code(),
                fmt::format("{}; {} bytes wait in memory", Message(trouble_), queued_bytes_));
}

void GroupCommitter::Loop() {
  ::pthread_setname_np(::pthread_self(), "segments");
  while (Wait()) {
    if (!Report(Advance())) return;
  }
}

bool GroupCommitter::WaitForRetry() {
  const auto retry_at = HostClock::now() + kRetryInterval;
  while (!retry_now_ && !closing_) {
    const auto left = retry_at - HostClock::now();
    if (left <= left.zero() || !changed_.WaitFor(mutex_, left)) break;
  }
  return true;
}

bool GroupCommitter::WaitForWork() {
  while (queue_.empty()) {
    const bool asked = flushing_ > 0 || blocked_ > 0 || closing_;
    if (GroupIsEmpty()) {
      if (closing_) return false;
      changed_.Wait(mutex_);
      continue;
    }
    const auto left = group_began_ + kCommitInterval - HostClock::now();
    if (asked || left <= left.zero() || !changed_.WaitFor(mutex_, left)) return true;
  }
  Queued next = std::move(queue_.front());
  queue_.pop_front();
  if (GroupIsEmpty()) group_began_ = HostClock::now();
  if (next.pixels == nullptr) {
    entries_.push_back(std::move(next.entry));
  } else {
    group_bytes_ += next.pixels->size();
    rows_.push_back(std::move(next.record));
    pixels_.push_back(std::move(next.pixels));
  }
  return true;
}

bool GroupCommitter::Wait() {
  MutexLock lock(mutex_);
  const bool goes_on = trouble_.ok() ? WaitForWork() : WaitForRetry();
  retry_now_ = false;
  trying_ = goes_on;
  return goes_on;
}

Status GroupCommitter::Advance() {
  MESORIG_RETURN_IF_ERROR(Write());
  return CommitIsDue() ? CommitGroup() : OkStatus();
}

Status GroupCommitter::Write() {
  for (; written_ < rows_.size(); ++written_) {
    FrameRecord& row = rows_[written_];
    const std::string& pixels = *pixels_[written_];
    if (row.digest.empty()) row.digest = FrameDigest(pixels);
    row.bytes = pixels.size();
    MESORIG_ASSIGN_OR_RETURN(row.offset, segments_.Append(row, pixels));
  }
  return OkStatus();
}

bool GroupCommitter::CommitIsDue() {
  if (GroupIsEmpty()) return false;
  if (group_bytes_ >= kCommitBytes || HostClock::now() - group_began_ >= kCommitInterval) {
    return true;
  }
  MutexLock lock(mutex_);
  return !trouble_.ok() || (queue_.empty() && (flushing_ > 0 || blocked_ > 0 || closing_));
}

Status GroupCommitter::CommitGroup() {
  if (!is_synced_) {
    const Status status = segments_.Sync();
    if (!status.ok()) {
      // What the disk has of the group is unknown: all of it is written again, to the same places.
      segments_.Rewind();
      written_ = 0;
      return status;
    }
    is_synced_ = true;
  }
  MESORIG_RETURN_IF_ERROR(ledger_->Commit(rows_, entries_));
  if (!rows_.empty()) on_commit_(rows_, pixels_);
  committed_ += rows_.size() + entries_.size();
  committed_bytes_ += group_bytes_;
  rows_.clear();
  pixels_.clear();
  entries_.clear();
  written_ = group_bytes_ = 0;
  is_synced_ = false;
  return OkStatus();
}

bool GroupCommitter::Report(const Status& status) {
  Status told;
  bool is_news = false, goes_on = true;
  {
    MutexLock lock(mutex_);
    if (status.ok()) {
      is_news = !trouble_.ok();
      trouble_ = OkStatus();
    } else if (absl::IsUnavailable(status)) {
      is_news = trouble_ != status;
      trouble_ = status;
      told = StorageLocked();
      goes_on = !closing_;
    } else {
      error_ = status;
      queue_.clear();  // never acknowledged
      goes_on = false;
    }
  }
  // (Whoever waits for the disk has heard of it when it is durable, or failed.)
  if (is_news && on_storage_) on_storage_(told);
  MutexLock lock(mutex_);
  trying_ = false;
  durable_ += committed_;
  queued_bytes_ -= committed_bytes_;
  committed_ = committed_bytes_ = 0;
  if (absl::IsUnavailable(status)) ++failures_;
  changed_.NotifyAll();
  return goes_on;
}

}  // namespace mesorig::daemon
