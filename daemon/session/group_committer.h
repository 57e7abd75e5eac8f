#pragma once
// Brings frames to the disk on a thread of its own: appends them to their segments, syncs the
// touched segments, then commits their ledger rows (and the journal's entries) in one transaction,
// at most kCommitInterval of host time after the oldest of them was written. Only then are they
// durable.
//
// A disk that takes nothing (full, read-only, failing, a busy journal) costs nothing: the group
// stays in memory, is tried again every kRetryInterval, and goes to the same places in the files. A
// damaged journal is for good.

#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "daemon/session/ledger.h"
#include "daemon/session/segment_files.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

inline constexpr std::chrono::milliseconds kCommitInterval{50};  // leaves as much for the syncs
inline constexpr size_t kCommitBytes = 32u << 20;                // or earlier, after so much
inline constexpr std::chrono::milliseconds kRetryInterval{500};

class GroupCommitter {
 public:
  using Pixels = std::vector<std::shared_ptr<const std::string>>;
  using OnCommit = std::function<void(const std::vector<FrameRecord>&, const Pixels&)>;
  // `on_commit` is called on the writer thread with the rows of each group and their pixels, in
  // order of Append; `on_storage` on the same thread, when the disk takes nothing any more, for
  // another reason than before, or (OK) takes it again.
  GroupCommitter(std::unique_ptr<Ledger> ledger, SegmentWriters segments, size_t max_queued_bytes,
                 OnCommit on_commit, std::function<void(const Status&)> on_storage);
  ~GroupCommitter();  // Close
  GroupCommitter(const GroupCommitter&) = delete;
  GroupCommitter& operator=(const GroupCommitter&) = delete;

  // Queues. Blocks (host time) while more than max_queued_bytes are not durable and the disk takes
  // them, however slowly; ResourceExhausted when it takes nothing: the frame is not kept. Returns
  // the writer's error when that is for good: nothing is written from then on.
  Status Append(FrameRecord record, std::shared_ptr<const std::string> pixels);
  // Queues; never blocks.
  Status Record(JournalEntry entry);
  // Returns when everything appended is durable, or when one more attempt has failed (Storage()),
  // or with the writer's error.
  Status Flush();
  // Tries a last time to bring everything to the disk and ends the thread.
  Status Close();
  // OK, or Unavailable: what failed, why, and how many bytes wait.
  Status Storage() const;

 private:
  struct Queued {
    FrameRecord record;
    std::shared_ptr<const std::string> pixels;  // null: an entry
    JournalEntry entry;
  };
  using HostClock = std::chrono::steady_clock;

  void Loop();
  // Waits for something to do and takes it into the group. False at the end.
  bool Wait() EXCLUDES(mutex_);
  bool WaitForRetry() REQUIRES(mutex_);
  bool WaitForWork() REQUIRES(mutex_);
  // Writes what is not written and commits when it is time.
  Status Advance();
  Status Write();
  Status CommitGroup();
  bool CommitIsDue() EXCLUDES(mutex_);
  bool GroupIsEmpty() const { return rows_.empty() && entries_.empty(); }
  // Takes note of what Advance returned; false: it is for good.
  bool Report(const Status& status) EXCLUDES(mutex_);
  Status StorageLocked() const REQUIRES(mutex_);

  const size_t max_queued_bytes_;
  const OnCommit on_commit_;
  const std::function<void(const Status&)> on_storage_;

  mutable Mutex mutex_;
  CondVar changed_;
  std::deque<Queued> queue_ GUARDED_BY(mutex_);
  size_t queued_bytes_ GUARDED_BY(mutex_) = 0;  // not yet durable
  uint64_t appended_ GUARDED_BY(mutex_) = 0, durable_ GUARDED_BY(mutex_) = 0;
  int flushing_ GUARDED_BY(mutex_) = 0;  // callers that wait in Flush
  int blocked_ GUARDED_BY(mutex_) = 0;   // and in Append
  bool retry_now_ GUARDED_BY(mutex_) = false, trying_ GUARDED_BY(mutex_) = false;
  uint64_t failures_ GUARDED_BY(mutex_) = 0;  // attempts that failed
  bool closing_ GUARDED_BY(mutex_) = false;
  Status trouble_ GUARDED_BY(mutex_);  // of the last attempt; OK: none
  Status error_ GUARDED_BY(mutex_);    // for good

  // Of the writer thread: the group.
  std::unique_ptr<Ledger> ledger_;
  SegmentWriters segments_;
  std::vector<FrameRecord> rows_;
  Pixels pixels_;  // one a row
  std::vector<JournalEntry> entries_;
  size_t written_ = 0;      // rows in their segments
  bool is_synced_ = false;  // all of them
  size_t group_bytes_ = 0;
  size_t committed_ = 0, committed_bytes_ = 0;  // since the last Report
  HostClock::time_point group_began_;

  std::thread thread_;
};

}  // namespace mesorig::daemon
