#pragma once
// The session on disk behind session.h: writing in stored_session.cc, reading in
// stored_session_reading.cc, opening in session.cc. Private to this folder.

#include <atomic>
#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "daemon/session/group_committer.h"
#include "daemon/session/ledger.h"
#include "daemon/session/live_frames.h"
#include "daemon/session/planned_sweeps.h"
#include "daemon/session/recent_frames.h"
#include "daemon/session/segment_files.h"
#include "daemon/session/session.h"
#include "daemon/session/session_folder.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

std::vector<std::string> CameraNames(const Rig& rig);

class StoredSession final : public Session {
 public:
  StoredSession(SessionFolder folder, Rig rig, std::string plan_bin, SessionSummary summary);
  ~StoredSession() override { writer_.reset(); }  // its thread calls OnCommit

  // Opens what reading needs. `faults`: of a session that will be written; may be null.
  Status OpenForReading(DiskFaults* faults);
  // Then: begins writing, at the end of what the ledger has. FailedPrecondition when somebody else
  // writes it.
  Status BeginWriting(const CompiledPlan& plan, const SessionOptions& options, bool resumes);
  // As SessionOptions::again asks: whether that is possible, before anything is written, and what
  // it does to Missing.
  Status CheckAgain(const CompiledPlan& plan, const ShotSelection& again);
  void Forget(const ShotSelection& again);
  void StaysComplete() { stays_complete_ = true; }
  // What a kill left of released sweeps. (On a disk that cannot be written it stays.)
  void RemoveReleased() const;

  const std::string& id() const override { return id_; }
  const std::string& rig_toml() const override { return rig_.source_text; }
  const std::string& plan_bin() const override { return plan_bin_; }
  SessionSummary Summary() const override {
    MutexLock lock(mutex_);
    return summary_;
  }
  Status Append(FrameRecord record, std::shared_ptr<const std::string> pixels) override;
  std::vector<int> Missing(uint32_t shot) const override;
  Status Record(JournalEntry entry) override;
  std::optional<double> MeteredExposure(int meter) const override;
  StatusOr<std::optional<StoredFrame>> Reference() override;
  StatusOr<uint32_t> DropDamaged() override;
  Status Storage() const override { return writer_ ? writer_->Storage() : OkStatus(); }
  void OnStorage(std::function<void(const Status&)> listener) override {
    MutexLock lock(listener_mutex_);
    on_storage_ = std::move(listener);
  }
  size_t FramesQueued() const override {
    MutexLock lock(mutex_);
    return pending_.size();
  }
  uint64_t FramesVerified() const override { return verified_; }
  Status Flush() override { return writer_ ? writer_->Flush() : NotWriting(); }
  Status Finish(bool complete, std::string_view reason, double virtual_s, double wall_s,
                bool deterministic) override;
  StatusOr<std::optional<StoredFrame>> Next(int camera, uint64_t cursor, int wait_ms) override;
  StatusOr<uint64_t> ReleaseSweep(uint32_t sweep) override;
  void OnDurable(std::function<void(uint32_t)> listener) override {
    MutexLock lock(listener_mutex_);
    on_durable_ = std::move(listener);
  }
  std::optional<LiveFrame> Latest(int camera, uint64_t after, int wait_ms) override;
  StatusOr<std::vector<JournalEntry>> Entries() override;

 private:
  Status NotWriting() const { return FailedPrecondition("session {} has ended", id_); }
  Status CheckFrame(const FrameRecord& record, const std::string* pixels) const;
  // The row that a frame of this camera and shot takes the place of; 0: none.
  StatusOr<uint64_t> RowOf(int camera, uint32_t shot);
  // Fills in what is there by the ledger's rows, and where their segments end.
  StatusOr<SegmentEnds> ReadPlaces(Ledger& ledger) EXCLUDES(mutex_);
  void OnCommit(const std::vector<FrameRecord>& rows, const GroupCommitter::Pixels& pixels);
  std::optional<StoredFrame> FindRecent(int camera, uint64_t sequence);
  void OnStorageChange(const Status& status);
  Status WriteEnd(SessionSummary ended, const JournalEntry& entry, bool must_be_written);
  StatusOr<FrameRecord> FindRow(int camera, uint64_t sequence);
  StatusOr<uint64_t> LastOfStretch(const FrameRecord& row) {
    MutexLock lock(reader_mutex_);
    return reader_->LastOfStretch(row);
  }
  // Waits for a durable row of `camera` beyond the cursor; false: none came.
  bool WaitForRow(int camera, uint64_t cursor, std::chrono::steady_clock::time_point deadline);
  StatusOr<PlannedSweep> FindSweep(uint32_t sweep) const;
  Status CheckDurable(const PlannedSweep& sweep);

  const SessionFolder folder_;
  const Rig rig_;
  const std::string plan_bin_;
  const std::string id_;
  // Set by BeginWriting, before anybody else sees this.
  bool live_ = false;  // frames may still come
  CompiledPlan plan_;
  PlannedSweeps sweeps_;
  DiskFaults* faults_ = nullptr;
  UniqueFd lock_;             // on the folder: one writer
  SessionSummary before_;     // the session record when this run began
  int64_t began_rig_ns_ = 0;  // when it did
  bool stays_complete_ = false;

  mutable Mutex mutex_;
  CondVar changed_;
  SessionSummary summary_ GUARDED_BY(mutex_);
  std::vector<uint64_t> next_sequence_;               // of the appending thread
  std::vector<uint64_t> durable_ GUARDED_BY(mutex_);  // each camera's last committed sequence
  LiveFrames live_frames_ GUARDED_BY(mutex_);
  // Rows that are not durable yet, by camera << 32 | shot: the last one's sequence.
  std::unordered_map<uint64_t, uint64_t> pending_ GUARDED_BY(mutex_);
  std::map<int, double> metered_ GUARDED_BY(mutex_);

  std::atomic<uint64_t> verified_{0};  // frames read again

  Mutex latest_mutex_;
  CondVar latest_changed_;
  std::vector<LiveFrame> latest_ GUARDED_BY(latest_mutex_);  // one a camera; count 0: none yet

  SegmentReaders segments_;
  RecentFrames recent_;  // of this writer
  Mutex release_mutex_;  // one ReleaseSweep at a time; taken before the others

  Mutex reader_mutex_;
  std::unique_ptr<Ledger> reader_ GUARDED_BY(reader_mutex_);

  Mutex listener_mutex_;
  std::function<void(uint32_t)> on_durable_ GUARDED_BY(listener_mutex_);
  std::function<void(const Status&)> on_storage_ GUARDED_BY(listener_mutex_);

  std::unique_ptr<GroupCommitter> writer_;  // none: opened for reading, or ended
};

}  // namespace mesorig::daemon
