#include <algorithm>

#include "daemon/session/released_sweeps.h"
#include "daemon/session/stored_session.h"

namespace mesorig::daemon {

void StoredSession::RemoveReleased() const {
  for (const uint32_t sweep : segments_.Released()) {
    (void)RemoveSweepSegments(folder_, CameraNames(rig_), sweep).status();
  }
}

StatusOr<std::vector<JournalEntry>> StoredSession::Entries() {
  MutexLock lock(reader_mutex_);
  return reader_->ReadEntries();
}

std::optional<LiveFrame> StoredSession::Latest(int camera, uint64_t after, int wait_ms) {
  if (!live_ || camera < 0 || static_cast<size_t>(camera) >= rig_.cameras.size()) {
    return std::nullopt;
  }
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::milliseconds(wait_ms);
  MutexLock lock(latest_mutex_);
  const LiveFrame& latest = latest_[static_cast<size_t>(camera)];
  while (latest.count <= after) {
    const auto left = deadline - std::chrono::steady_clock::now();
    if (left <= left.zero()) return std::nullopt;
    latest_changed_.WaitFor(latest_mutex_, left);
  }
  return latest;
}

StatusOr<std::optional<StoredFrame>> StoredSession::Reference() {
  if (!live_) return NotWriting();
  for (auto step = plan_.steps.rbegin(); step != plan_.steps.rend(); ++step) {
    if (step->kind != StepKind::kShot || step->purpose != Purpose::kData) continue;
    for (const int camera : step->cameras) {
      {
        MutexLock lock(mutex_);
        if (!live_frames_.IsLive(camera, step->shot)) continue;
      }
      std::optional<FrameRecord> row;
      {
        MutexLock lock(reader_mutex_);
        MESORIG_ASSIGN_OR_RETURN(const uint64_t sequence, reader_->LastOfShot(camera, step->shot));
        if (sequence != 0) {
          MESORIG_ASSIGN_OR_RETURN(row, reader_->Find(camera, sequence));
        }
      }
      if (!row || row->camera != camera) continue;  // not durable yet
      if (auto pixels = segments_.Read(*row); pixels.ok() && *pixels != nullptr) {
        return std::optional<StoredFrame>(StoredFrame{*std::move(row), *std::move(pixels)});
      }
    }
  }
  return std::optional<StoredFrame>();
}

StatusOr<FrameRecord> StoredSession::FindRow(int camera, uint64_t sequence) {
  MutexLock lock(reader_mutex_);
  MESORIG_ASSIGN_OR_RETURN(std::optional<FrameRecord> row, reader_->Find(camera, sequence));
  // (A damaged one may answer with another row.)
  if (!row || row->camera != camera || row->sequence != sequence) {
    return DataLoss("{}: row {} of camera {} is missing", folder_.journal().string(), sequence,
                    rig_.cameras[static_cast<size_t>(camera)].name);
  }
  return *std::move(row);
}

std::optional<StoredFrame> StoredSession::FindRecent(int camera, uint64_t sequence) {
  std::optional<StoredFrame> frame = recent_.Find(camera, sequence);
  if (frame && segments_.IsReleased(frame->record.segment)) return std::nullopt;
  return frame;
}

StatusOr<std::optional<StoredFrame>> StoredSession::Next(int camera, uint64_t cursor, int wait_ms) {
  if (camera < 0 || static_cast<size_t>(camera) >= rig_.cameras.size()) {
    return InvalidArgument("session {}: camera {}, the rig has {}", id_, camera,
                           rig_.cameras.size());
  }
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::milliseconds(wait_ms);
  while (WaitForRow(camera, cursor, deadline)) {
    if (auto recent = FindRecent(camera, cursor + 1)) return recent;
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

}  // namespace mesorig::daemon
