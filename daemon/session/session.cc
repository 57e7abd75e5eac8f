#include "daemon/session/session.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "daemon/session/group_committer.h"
#include "daemon/session/ledger.h"
#include "daemon/session/planned_sweeps.h"
#include "daemon/session/reconcile.h"
#include "daemon/session/released_sweeps.h"
#include "daemon/session/segment_files.h"
#include "daemon/session/session_folder.h"
#include "protocol/base/digest.h"
#include "protocol/base/file_writer.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {
namespace {

std::vector<std::string> CameraNames(const Rig& rig) {
  std::vector<std::string> names;
  for (const mesorig::Camera& camera : rig.cameras) names.push_back(camera.name);
  return names;
}

class StoredSession final : public Session {
 public:
  StoredSession(SessionFolder folder, Rig rig, std::string plan_bin, SessionSummary summary)
      : folder_(std::move(folder)),
        rig_(std::move(rig)),
        plan_bin_(std::move(plan_bin)),
        id_(summary.id),
        summary_(std::move(summary)),
        next_sequence_(rig_.cameras.size(), 1),
        durable_(rig_.cameras.size(), 0),
        segments_(folder_, CameraNames(rig_), FindReleased(folder_, id_)) {}
  ~StoredSession() override { writer_.reset(); }  // its thread calls OnCommit

  // Opens the reader's ends; `plan`: begins writing.
  Status OpenFiles(const CompiledPlan* plan, const SessionOptions& options);

  // What a kill left of released sweeps. (On a disk that cannot be written it stays.)
  void RemoveReleased() const {
    for (const uint32_t sweep : segments_.Released()) {
      (void)RemoveSweepSegments(folder_, CameraNames(rig_), sweep).status();
    }
  }

  const std::string& id() const override { return id_; }
  const std::string& rig_toml() const override { return rig_.source_text; }
  const std::string& plan_bin() const override { return plan_bin_; }
  SessionSummary Summary() const override {
    MutexLock lock(mutex_);
    return summary_;
  }
  Status Append(FrameRecord record, std::shared_ptr<const std::string> pixels) override;
  Status Flush() override { return writer_ ? writer_->Flush() : NotWriting(); }
  Status Finish(bool complete, std::string_view reason, double virtual_s, double wall_s,
                bool deterministic) override;
  StatusOr<std::optional<StoredFrame>> Next(int camera, uint64_t cursor, int wait_ms) override;
  StatusOr<uint64_t> ReleaseSweep(uint32_t sweep) override;
  void OnDurable(std::function<void(uint32_t)> listener) override {
    MutexLock lock(listener_mutex_);
    listener_ = std::move(listener);
  }

 private:
  bool live_ = false;  // frames may still come; set before anybody else sees this
  Status NotWriting() const { return FailedPrecondition("session {} has ended", id_); }
  Status CheckFrame(const FrameRecord& record, const std::string* pixels) const;
  void OnCommit(const std::vector<FrameRecord>& rows);
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
  CompiledPlan plan_;     // while writing
  PlannedSweeps sweeps_;  // while writing

  mutable Mutex mutex_;
  CondVar changed_;
  SessionSummary summary_ GUARDED_BY(mutex_);
  std::vector<uint64_t> next_sequence_;               // of the appending thread
  std::vector<uint64_t> durable_ GUARDED_BY(mutex_);  // each camera's last committed sequence

  SegmentReaders segments_;
  Mutex release_mutex_;  // one ReleaseSweep at a time; taken before the others

  Mutex reader_mutex_;
  std::unique_ptr<Ledger> reader_ GUARDED_BY(reader_mutex_);

  Mutex listener_mutex_;
  std::function<void(uint32_t)> listener_ GUARDED_BY(listener_mutex_);

  std::unique_ptr<GroupCommitter> writer_;  // none: opened for reading, or ended
};

Status StoredSession::OpenFiles(const CompiledPlan* plan, const SessionOptions& options) {
  {
    MutexLock lock(reader_mutex_);
    MESORIG_ASSIGN_OR_RETURN(reader_, Ledger::Open(folder_.journal()));
    MutexLock state_lock(mutex_);
    MESORIG_ASSIGN_OR_RETURN(durable_,
                             reader_->LastSequences(static_cast<int>(rig_.cameras.size())));
  }
  if (plan == nullptr) return OkStatus();
  plan_ = *plan;
  sweeps_ = PlannedSweeps(plan_);
  live_ = true;
  MESORIG_ASSIGN_OR_RETURN(SegmentWriters writers,
                           SegmentWriters::Open(folder_, CameraNames(rig_), sweeps_));
  MESORIG_ASSIGN_OR_RETURN(std::unique_ptr<Ledger> ledger, Ledger::Open(folder_.journal()));
  writer_ = std::make_unique<GroupCommitter>(
      std::move(ledger), std::move(writers), options.max_queued_bytes,
      [this](const std::vector<FrameRecord>& rows) { OnCommit(rows); });
  return OkStatus();
}

Status StoredSession::CheckFrame(const FrameRecord& r, const std::string* pixels) const {
  if (r.camera < 0 || static_cast<size_t>(r.camera) >= rig_.cameras.size()) {
    return InvalidArgument("session {}: a frame of camera {}, the rig has {}", id_, r.camera,
                           rig_.cameras.size());
  }
  const mesorig::Camera& camera = rig_.cameras[static_cast<size_t>(r.camera)];
  const size_t expected = static_cast<size_t>(std::max(0, r.width)) *
                          static_cast<size_t>(std::max(0, r.height)) * (r.bits > 8 ? 2 : 1);
  if (pixels == nullptr || pixels->size() != expected || expected == 0) {
    return InvalidArgument("session {}: camera {}, shot {}: {} bytes for {} x {} pixels of {} bits",
                           id_, camera.name, r.shot, pixels == nullptr ? 0 : pixels->size(),
                           r.width, r.height, r.bits);
  }
  if (r.region_x < 0 || r.region_y < 0 || (r.laser && !std::isfinite(r.laser->tilt_rad))) {
    return InvalidArgument(
        "session {}: camera {}, shot {}: region at ({}, {}) or tilt {} rad cannot be", id_,
        camera.name, r.shot, r.region_x, r.region_y, r.laser ? r.laser->tilt_rad : 0);
  }
  return OkStatus();
}

Status StoredSession::Append(FrameRecord record, std::shared_ptr<const std::string> pixels) {
  if (!writer_) return NotWriting();
  MESORIG_RETURN_IF_ERROR(CheckFrame(record, pixels.get()));
  record.segment = sweeps_.SegmentOf(record.camera, record.shot);
  if (segments_.IsReleased(record.segment)) {
    return FailedPrecondition("session {}: shot {} is of sweep {}, which was released", id_,
                              record.shot, record.segment - 1);
  }
  record.sequence = next_sequence_[static_cast<size_t>(record.camera)]++;
  return writer_->Append(std::move(record), std::move(pixels));
}

void StoredSession::OnCommit(const std::vector<FrameRecord>& rows) {
  uint32_t frames_durable = 0;
  {
    MutexLock lock(mutex_);
    for (const FrameRecord& row : rows) durable_[static_cast<size_t>(row.camera)] = row.sequence;
    summary_.frames_durable += static_cast<uint32_t>(rows.size());
    frames_durable = summary_.frames_durable;
    changed_.NotifyAll();
  }
  MutexLock lock(listener_mutex_);
  if (listener_) listener_(frames_durable);
}

Status StoredSession::Finish(bool complete, std::string_view reason, double virtual_s,
                             double wall_s, bool deterministic) {
  if (!writer_) return NotWriting();
  Status status = writer_->Close();
  if (status.ok() && complete) {
    const auto verify = [&](const FrameRecord& row) { return segments_.Read(row).status(); };
    status =
        Annotate(Reconcile(plan_, rig_, writer_->ledger(), verify), fmt::format("session {}", id_));
  }
  SessionSummary ended = Summary();
  ended.end = complete && status.ok() ? SessionEnd::kComplete : SessionEnd::kIncomplete;
  if (ended.end == SessionEnd::kIncomplete) {
    ended.reason = status.ok() ? std::string(reason) : std::string(Message(status));
  }
  ended.virtual_s = virtual_s;
  ended.wall_s = wall_s;
  ended.deterministic = deterministic;
  // The end is written even when the writer failed: its error then stands as the reason.
  Status written = writer_->ledger().WriteEnd(ended);
  if (written.ok()) written = writer_->ledger().Checkpoint();
  if (status.ok()) status = written;
  writer_.reset();
  MutexLock lock(mutex_);
  if (!written.ok()) {
    ended.end = SessionEnd::kIncomplete;
    ended.reason = std::string(Message(written));
  }
  summary_ = ended;
  changed_.NotifyAll();
  return status;
}

StatusOr<FrameRecord> StoredSession::FindRow(int camera, uint64_t sequence) {
  MutexLock lock(reader_mutex_);
  MESORIG_ASSIGN_OR_RETURN(std::optional<FrameRecord> row, reader_->Find(camera, sequence));
  if (!row) {
    return DataLoss("{}: row {} of camera {} is missing", folder_.journal().string(), sequence,
                    rig_.cameras[static_cast<size_t>(camera)].name);
  }
  return *std::move(row);
}

StatusOr<std::optional<StoredFrame>> StoredSession::Next(int camera, uint64_t cursor, int wait_ms) {
  if (camera < 0 || static_cast<size_t>(camera) >= rig_.cameras.size()) {
    return InvalidArgument("session {}: camera {}, the rig has {}", id_, camera,
                           rig_.cameras.size());
  }
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::milliseconds(wait_ms);
  while (WaitForRow(camera, cursor, deadline)) {
    MESORIG_ASSIGN_OR_RETURN(FrameRecord row, FindRow(camera, cursor + 1));
    MESORIG_ASSIGN_OR_RETURN(auto pixels, segments_.Read(row));
    if (pixels != nullptr) {
      return std::optional<StoredFrame>(StoredFrame{std::move(row), std::move(pixels)});
    }
    MESORIG_ASSIGN_OR_RETURN(cursor, LastOfStretch(row));
  }
  return std::optional<StoredFrame>();
}

bool StoredSession::WaitForRow(int camera, uint64_t cursor,
                               std::chrono::steady_clock::time_point deadline) {
  MutexLock lock(mutex_);
  while (durable_[static_cast<size_t>(camera)] <= cursor) {
    const auto left = deadline - std::chrono::steady_clock::now();
    if (!live_ || summary_.end != SessionEnd::kOpen || left <= left.zero()) return false;
    changed_.WaitFor(mutex_, left);
  }
  return true;
}

StatusOr<PlannedSweep> StoredSession::FindSweep(uint32_t sweep) const {
  PlannedSweeps unpacked;
  if (!live_) {  // (one that is read only has not looked into its plan before)
    MESORIG_ASSIGN_OR_RETURN(const CompiledPlan plan, UnpackPlan(plan_bin_, rig_));
    MESORIG_RETURN_IF_ERROR(CheckPlan(plan, rig_));
    unpacked = PlannedSweeps(plan);
  }
  const PlannedSweep* found = (live_ ? sweeps_ : unpacked).Find(sweep);
  if (found == nullptr) return NotFound("session {}: its plan has no sweep {}", id_, sweep);
  return *found;
}

// Every planned frame has its row, and the disk has what the rows speak of: what was lost is never
// called released.
Status StoredSession::CheckDurable(const PlannedSweep& sweep) {
  for (const int camera : sweep.cameras) {
    const std::string& name = rig_.cameras[static_cast<size_t>(camera)].name;
    Ledger::Coverage rows;
    {
      MutexLock lock(reader_mutex_);
      MESORIG_ASSIGN_OR_RETURN(
          rows, reader_->Cover(camera, sweep.segment(), sweep.first_shot, sweep.frames));
    }
    if (rows.shots != sweep.frames) {
      return FailedPrecondition("session {}: sweep {}: {} of {} frames of camera {} are durable",
                                id_, sweep.sweep, rows.shots, sweep.frames, name);
    }
    const std::filesystem::path path = folder_.segment(name, sweep.segment());
    std::error_code error;
    const uint64_t bytes = std::filesystem::file_size(path, error);
    if (error || bytes < rows.last_bytes + kRecordHeaderBytes) {
      return DataLoss("{}: has {} bytes, the ledger's rows need {}", path.string(),
                      error ? 0 : bytes, rows.last_bytes + kRecordHeaderBytes);
    }
  }
  return OkStatus();
}

StatusOr<uint64_t> StoredSession::ReleaseSweep(uint32_t sweep) {
  MutexLock lock(release_mutex_);
  MESORIG_ASSIGN_OR_RETURN(const PlannedSweep planned, FindSweep(sweep));
  if (planned.keep_frames) {
    return FailedPrecondition("session {}: the plan keeps the frames of sweep {}", id_, sweep);
  }
  if (!segments_.IsReleased(planned.segment())) {
    MESORIG_RETURN_IF_ERROR(CheckDurable(planned));
    MESORIG_RETURN_IF_ERROR(MarkReleased(folder_, id_, sweep));
    segments_.Release(sweep);  // before the files go: a reader that misses one sees why
  }
  return RemoveSweepSegments(folder_, CameraNames(rig_), sweep);
}

Status CheckSha(const std::filesystem::path& file, std::string_view bytes,
                std::string_view recorded) {
  if (const std::string sha = Sha256(bytes); sha != recorded) {
    return DataLoss("{}: SHA-256 is {}, the journal recorded {}", file.string(), sha, recorded);
  }
  return OkStatus();
}

}  // namespace

StatusOr<std::shared_ptr<Session>> Session::Create(const std::filesystem::path& root,
                                                   const CompiledPlan& plan, const Rig& rig,
                                                   SessionOptions options) {
  MESORIG_RETURN_IF_ERROR(CheckPlan(plan, rig));
  std::string plan_bin = PackPlan(plan);
  SessionSummary summary;
  summary.plan_name = plan.name;
  summary.plan_sha256 = Sha256(plan_bin);
  summary.rig_sha256 = rig.sha256;
  summary.frames_planned = plan.frames;
  MESORIG_ASSIGN_OR_RETURN(SessionFolder folder, CreateSessionFolder(root, rig, plan_bin, summary));
  auto session = std::make_shared<StoredSession>(std::move(folder), rig, std::move(plan_bin),
                                                 std::move(summary));
  MESORIG_RETURN_IF_ERROR(session->OpenFiles(&plan, options));
  return session;
}

StatusOr<std::shared_ptr<Session>> Session::Open(const std::filesystem::path& root,
                                                 const std::string& id) {
  std::error_code error;
  SessionFolder folder(root / id);
  if (!IsFileName(id) || !std::filesystem::exists(folder.journal(), error)) {
    return NotFound("no session \"{}\" in {}", id, root.string());
  }
  MESORIG_ASSIGN_OR_RETURN(const auto ledger, Ledger::Open(folder.journal()));
  MESORIG_ASSIGN_OR_RETURN(SessionSummary summary, ledger->ReadSummary());
  MESORIG_ASSIGN_OR_RETURN(std::string plan_bin, ReadFile(folder.plan(), size_t{1} << 30));
  MESORIG_RETURN_IF_ERROR(CheckSha(folder.plan(), plan_bin, summary.plan_sha256));
  MESORIG_ASSIGN_OR_RETURN(const std::string rig_toml, ReadFile(folder.rig()));
  MESORIG_RETURN_IF_ERROR(CheckSha(folder.rig(), rig_toml, summary.rig_sha256));
  MESORIG_ASSIGN_OR_RETURN(Rig rig, ParseRig(rig_toml, folder.rig().string()));
  auto session = std::make_shared<StoredSession>(std::move(folder), std::move(rig),
                                                 std::move(plan_bin), std::move(summary));
  MESORIG_RETURN_IF_ERROR(session->OpenFiles(nullptr, {}));
  session->RemoveReleased();
  return session;
}

StatusOr<std::shared_ptr<Session>> Session::Resume(const std::filesystem::path&, const std::string&,
                                                   const Rig&, SessionOptions) {
  return Unimplemented("resuming a session is not there yet");
}

}  // namespace mesorig::daemon
