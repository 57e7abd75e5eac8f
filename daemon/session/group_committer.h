#pragma once
// Brings frames to the disk on a thread of its own: appends them to their segments, syncs the
// touched segments, then commits their ledger rows in one transaction, at most kCommitInterval of
// host time after the oldest of them was written. Only then are they durable.

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

class GroupCommitter {
 public:
  // `on_commit` is called on the writer thread with the rows of each group, in order of Append.
  GroupCommitter(std::unique_ptr<Ledger> ledger, SegmentWriters segments, size_t max_queued_bytes,
                 std::function<void(const std::vector<FrameRecord>&)> on_commit);
  ~GroupCommitter();  // Close
  GroupCommitter(const GroupCommitter&) = delete;
  GroupCommitter& operator=(const GroupCommitter&) = delete;

  // Queues. Blocks (host time) while more than max_queued_bytes wait for the disk. Returns the
  // writer's error if it had one: nothing is written from then on.
  Status Append(FrameRecord record, std::shared_ptr<const std::string> pixels);
  // Returns when everything appended is durable, or with the writer's error.
  Status Flush();
  // Flushes and ends the thread.
  Status Close();
  // The writer's connection; after Close.
  Ledger& ledger() { return *ledger_; }

 private:
  struct Queued {
    FrameRecord record;
    std::shared_ptr<const std::string> pixels;
  };
  using HostClock = std::chrono::steady_clock;

  void Loop();
  // Waits for a frame, for the time of a commit, or for the end. False at the end.
  bool Wait(Queued& next, bool& has_next) EXCLUDES(mutex_);
  Status Write(Queued& queued);
  Status CommitGroup();
  bool CommitIsDue() EXCLUDES(mutex_);
  void Fail(const Status& error) EXCLUDES(mutex_);

  const size_t max_queued_bytes_;
  const std::function<void(const std::vector<FrameRecord>&)> on_commit_;

  Mutex mutex_;
  CondVar changed_;
  std::deque<Queued> queue_ GUARDED_BY(mutex_);
  size_t queued_bytes_ GUARDED_BY(mutex_) = 0;
  uint64_t appended_ GUARDED_BY(mutex_) = 0, durable_ GUARDED_BY(mutex_) = 0;
  bool flush_ GUARDED_BY(mutex_) = false;
  bool closing_ GUARDED_BY(mutex_) = false;
  Status error_ GUARDED_BY(mutex_);

  // Of the writer thread.
  std::unique_ptr<Ledger> ledger_;
  SegmentWriters segments_;
  std::vector<FrameRecord> group_;  // written, not yet committed
  size_t group_bytes_ = 0;
  HostClock::time_point group_began_;

  std::thread thread_;
};

}  // namespace mesorig::daemon
