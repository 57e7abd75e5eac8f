#include "daemon/session/group_committer.h"

#include <pthread.h>

#include "protocol/base/digest.h"

namespace mesorig::daemon {

GroupCommitter::GroupCommitter(std::unique_ptr<Ledger> ledger, SegmentWriters segments,
                               size_t max_queued_bytes,
                               std::function<void(const std::vector<FrameRecord>&)> on_commit)
    : max_queued_bytes_(max_queued_bytes),
      on_commit_(std::move(on_commit)),
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
  while (error_.ok() && queued_bytes_ > 0 && queued_bytes_ + bytes > max_queued_bytes_) {
    changed_.Wait(mutex_);
  }
  MESORIG_RETURN_IF_ERROR(error_);
  queue_.push_back({std::move(record), std::move(pixels)});
  queued_bytes_ += bytes;
  ++appended_;
  changed_.NotifyAll();
  return OkStatus();
}

Status GroupCommitter::Flush() {
  MutexLock lock(mutex_);
  flush_ = true;
  changed_.NotifyAll();
  while (error_.ok() && durable_ < appended_) changed_.Wait(mutex_);
  flush_ = false;
  return error_;
}

Status GroupCommitter::Close() {
  {
    MutexLock lock(mutex_);
    closing_ = true;
    changed_.NotifyAll();
  }
  if (thread_.joinable()) thread_.join();
  MutexLock lock(mutex_);
  return error_;
}

void GroupCommitter::Loop() {
  ::pthread_setname_np(::pthread_self(), "segments");
  Queued next;
  bool has_next = false;
  while (Wait(next, has_next)) {
    Status status = has_next ? Write(next) : OkStatus();
    next = {};
    if (status.ok() && CommitIsDue()) status = CommitGroup();
    if (!status.ok()) {
      Fail(status);
      return;
    }
  }
}

bool GroupCommitter::Wait(Queued& next, bool& has_next) {
  MutexLock lock(mutex_);
  while (queue_.empty() && !flush_ && !closing_) {
    if (group_.empty()) {
      changed_.Wait(mutex_);
      continue;
    }
    const auto left = group_began_ + kCommitInterval - HostClock::now();
    if (left <= left.zero() || !changed_.WaitFor(mutex_, left)) break;
  }
  // A flush with nothing left to do waits here for the next change.
  while (queue_.empty() && group_.empty() && !closing_) changed_.Wait(mutex_);
  has_next = !queue_.empty();
  if (has_next) {
    next = std::move(queue_.front());
    queue_.pop_front();
  }
  return has_next || !group_.empty();
}

Status GroupCommitter::Write(Queued& queued) {
  FrameRecord& record = queued.record;
  record.digest = FrameDigest(*queued.pixels);
  record.bytes = queued.pixels->size();
  MESORIG_ASSIGN_OR_RETURN(record.offset, segments_.Append(record, *queued.pixels));
  if (group_.empty()) group_began_ = HostClock::now();
  group_bytes_ += record.bytes;
  group_.push_back(std::move(record));
  MutexLock lock(mutex_);
  queued_bytes_ -= queued.pixels->size();
  changed_.NotifyAll();
  return OkStatus();
}

bool GroupCommitter::CommitIsDue() {
  if (group_.empty()) return false;
  if (group_bytes_ >= kCommitBytes || HostClock::now() - group_began_ >= kCommitInterval) {
    return true;
  }
  MutexLock lock(mutex_);
  return queue_.empty() && (flush_ || closing_);
}

Status GroupCommitter::CommitGroup() {
  MESORIG_RETURN_IF_ERROR(segments_.Sync());
  MESORIG_RETURN_IF_ERROR(ledger_->Commit(group_));
  on_commit_(group_);
  MutexLock lock(mutex_);
  durable_ += group_.size();
  group_.clear();
  group_bytes_ = 0;
  changed_.NotifyAll();
  return OkStatus();
}

void GroupCommitter::Fail(const Status& error) {
  MutexLock lock(mutex_);
  error_ = error;
  queue_.clear();  // never acknowledged
  queued_bytes_ = 0;
  changed_.NotifyAll();
}

}  // namespace mesorig::daemon
