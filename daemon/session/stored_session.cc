#include "daemon/session/stored_session.h"

#include <algorithm>
#include <cmath>

#include "daemon/session/reconcile.h"
#include "protocol/base/frame_memory.h"

namespace mesorig::daemon {
namespace {

uint64_t KeyOf(int camera, uint32_t shot) { return (static_cast<uint64_t>(camera) << 32) | shot; }

bool AllFinite(const FrameRecord& r) {
  return std::isfinite(r.exposure_s) && (!r.laser || std::isfinite(r.laser->tilt_rad));
}

}  // namespace

std::vector<std::string> CameraNames(const Rig& rig) {
  std::vector<std::string> names;
  for (const mesorig::Camera& camera : rig.cameras) names.push_back(camera.name);
  return names;
}

StoredSession::StoredSession(SessionFolder folder, Rig rig, std::string plan_bin,
                             SessionSummary summary)
    : folder_(std::move(folder)),
      rig_(std::move(rig)),
      plan_bin_(std::move(plan_bin)),
      id_(summary.id),
      summary_(std::move(summary)),
      next_sequence_(rig_.cameras.size(), 1),
      durable_(rig_.cameras.size(), 0),
      latest_(rig_.cameras.size()),
      segments_(folder_, id_, CameraNames(rig_)),
      recent_(rig_.cameras.size(), kRecentBytes) {}

Status StoredSession::OpenForReading(DiskFaults* faults) {
  faults_ = faults;
  MutexLock lock(reader_mutex_);
  MESORIG_ASSIGN_OR_RETURN(reader_, Ledger::Open(folder_.journal(), faults_));
  MutexLock state_lock(mutex_);
  MESORIG_ASSIGN_OR_RETURN(durable_, reader_->LastSequences(static_cast<int>(rig_.cameras.size())));
  return OkStatus();
}

Status StoredSession::BeginWriting(const CompiledPlan& plan, const SessionOptions& options,
                                   bool resumes) {
  MESORIG_ASSIGN_OR_RETURN(lock_, LockSession(folder_));
  plan_ = plan;
  sweeps_ = PlannedSweeps(plan_);
  live_ = true;
  MESORIG_ASSIGN_OR_RETURN(std::unique_ptr<Ledger> ledger,
                           Ledger::Open(folder_.journal(), faults_));
  MESORIG_ASSIGN_OR_RETURN(SegmentEnds ends, ReadPlaces(*ledger));
  MESORIG_ASSIGN_OR_RETURN(const auto entries, ledger->ReadEntries());
  MESORIG_ASSIGN_OR_RETURN(
      SegmentWriters writers,
      SegmentWriters::Open(folder_, CameraNames(rig_), sweeps_, std::move(ends), faults_));
  if (resumes) {
    segments_.OpenMain();
    MESORIG_RETURN_IF_ERROR(ledger->WriteStart());
  }
  {
    MutexLock lock(mutex_);
    MESORIG_ASSIGN_OR_RETURN(summary_, ledger->ReadSummary());
    before_ = summary_;
    for (const JournalEntry& entry : entries) {
      if (entry.kind == JournalKind::kExposure) metered_[entry.index] = entry.value;
    }
  }
  writer_ = std::make_unique<GroupCommitter>(
      std::move(ledger), std::move(writers), options.max_queued_bytes,
      [this](const auto& rows, const auto& pixels) { OnCommit(rows, pixels); },
      [this](const Status& status) { OnStorageChange(status); });
  return OkStatus();
}

StatusOr<SegmentEnds> StoredSession::ReadPlaces(Ledger& ledger) {
  LiveFrames live_frames(plan_, static_cast<int>(rig_.cameras.size()));
  std::vector<uint64_t> last(rig_.cameras.size(), 0);
  SegmentEnds ends;
  MESORIG_RETURN_IF_ERROR(ledger.ForEachPlace([&](const Ledger::Place& place) -> Status {
    const bool fits = place.camera >= 0 && static_cast<size_t>(place.camera) < last.size() &&
                      place.sequence == last[static_cast<size_t>(place.camera)] + 1 &&
                      place.bytes <= kMaxFrameBytes && place.offset < UINT64_MAX / 2;
    if (!fits) {
      return DataLoss("{}: row {} of camera {} cannot be: {} bytes at {}, rows before it: {}",
                      folder_.journal().string(), place.sequence, place.camera, place.bytes,
                      place.offset,
                      place.camera >= 0 && static_cast<size_t>(place.camera) < last.size()
                          ? last[static_cast<size_t>(place.camera)]
                          : 0);
    }
    last[static_cast<size_t>(place.camera)] = place.sequence;
    live_frames.Add(place.camera, place.shot);
    uint64_t& end = ends[{place.camera, place.segment}];
    end = std::max(end, place.offset + kRecordHeaderBytes + place.bytes);
    return OkStatus();
  }));
  MutexLock lock(mutex_);
  live_frames_ = std::move(live_frames);
  durable_ = last;
  for (size_t i = 0; i < last.size(); ++i) next_sequence_[i] = last[i] + 1;
  return ends;
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
  if (r.region_x < 0 || r.region_y < 0 || !AllFinite(r)) {
    return InvalidArgument(
        "session {}: camera {}, shot {}: region at ({}, {}), exposure {} s or tilt {} rad cannot "
        "be",
        id_, camera.name, r.shot, r.region_x, r.region_y, r.exposure_s,
        r.laser ? r.laser->tilt_rad : 0);
  }
  return OkStatus();
}

StatusOr<uint64_t> StoredSession::RowOf(int camera, uint32_t shot) {
  {
    MutexLock lock(mutex_);
    if (!live_frames_.HasRow(camera, shot)) return 0;
    if (const auto found = pending_.find(KeyOf(camera, shot)); found != pending_.end()) {
      return found->second;
    }
  }
  MutexLock lock(reader_mutex_);
  return reader_->LastOfShot(camera, shot);
}

Status StoredSession::Append(FrameRecord record, std::shared_ptr<const std::string> pixels) {
  if (!writer_) return NotWriting();
  MESORIG_RETURN_IF_ERROR(CheckFrame(record, pixels.get()));
  record.segment = sweeps_.SegmentOf(record.camera, record.shot);
  if (segments_.IsReleased(record.segment)) {
    return FailedPrecondition("session {}: shot {} is of sweep {}, which was released", id_,
                              record.shot, record.segment - 1);
  }
  MESORIG_ASSIGN_OR_RETURN(record.supersedes, RowOf(record.camera, record.shot));
  const auto camera = static_cast<size_t>(record.camera);
  record.sequence = next_sequence_[camera];
  record.run = before_.starts - 1;
  record.digest.clear();
  {
    MutexLock lock(latest_mutex_);
    latest_[camera] = {{record, pixels}, latest_[camera].count + 1};
    latest_changed_.NotifyAll();
  }
  const int index = record.camera;
  const uint32_t shot = record.shot;
  {
    // (Before the writer has it: OnCommit takes it out again.)
    MutexLock lock(mutex_);
    pending_[KeyOf(index, shot)] = record.sequence;
  }
  const Status status = writer_->Append(std::move(record), std::move(pixels));
  MutexLock lock(mutex_);
  if (status.ok()) {
    ++next_sequence_[camera];
    live_frames_.Add(index, shot);
  } else {
    pending_.erase(KeyOf(index, shot));
  }
  return status;
}

std::vector<int> StoredSession::Missing(uint32_t shot) const {
  MutexLock lock(mutex_);
  return live_frames_.Missing(shot);
}

Status StoredSession::CheckAgain(const CompiledPlan& plan, const ShotSelection& again) {
  const PlannedSweeps sweeps(plan);
  for (const SelectedShot& selected : again) {
    if (selected.shot >= plan.shots) {
      return InvalidArgument("session {}: shot {}, the plan has {}", id_, selected.shot,
                             plan.shots);
    }
    for (const int camera : selected.cameras) {
      if (camera < 0 || static_cast<size_t>(camera) >= rig_.cameras.size()) {
        return InvalidArgument("session {}: camera {}, the rig has {}", id_, camera,
                               rig_.cameras.size());
      }
      if (!segments_.IsReleased(sweeps.SegmentOf(camera, selected.shot))) continue;
      return FailedPrecondition("session {}: shot {} is of a sweep that was released", id_,
                                selected.shot);
    }
  }
  return OkStatus();
}

void StoredSession::Forget(const ShotSelection& again) {
  MutexLock lock(mutex_);
  for (const SelectedShot& selected : again) {
    for (const int camera : selected.cameras) live_frames_.Drop(camera, selected.shot);
  }
}

Status StoredSession::Record(JournalEntry entry) {
  if (!writer_) return NotWriting();
  if (!std::isfinite(entry.value)) {
    return InvalidArgument("session {}: a journal entry of kind {} with the value {}", id_,
                           static_cast<int>(entry.kind), entry.value);
  }
  const bool is_exposure = entry.kind == JournalKind::kExposure;
  if (entry.kind == JournalKind::kBegan || entry.kind == JournalKind::kResumed) {
    began_rig_ns_ = entry.rig_ns;
  }
  const int index = entry.index;
  const double value = entry.value;
  MESORIG_RETURN_IF_ERROR(writer_->Record(std::move(entry)));
  MutexLock lock(mutex_);
  if (is_exposure) metered_[index] = value;
  return OkStatus();
}

std::optional<double> StoredSession::MeteredExposure(int meter) const {
  MutexLock lock(mutex_);
  const auto found = metered_.find(meter);
  if (found == metered_.end()) return std::nullopt;
  return found->second;
}

StatusOr<uint32_t> StoredSession::DropDamaged() {
  MESORIG_RETURN_IF_ERROR(Flush());
  // A connection of its own: consumers go on reading meanwhile.
  MESORIG_ASSIGN_OR_RETURN(const auto ledger, Ledger::Open(folder_.journal(), faults_));
  uint32_t damaged = 0;
  MESORIG_RETURN_IF_ERROR(ledger->ForEachLive([&](const FrameRecord& row) {
    {
      MutexLock lock(mutex_);
      if (!live_frames_.IsLive(row.camera, row.shot)) return OkStatus();
    }
    ++verified_;
    if (segments_.Read(row).ok()) return OkStatus();
    ++damaged;
    MutexLock lock(mutex_);
    live_frames_.Drop(row.camera, row.shot);
    return OkStatus();
  }));
  return damaged;
}

void StoredSession::OnCommit(const std::vector<FrameRecord>& rows,
                             const GroupCommitter::Pixels& pixels) {
  // (Before a consumer hears of them.)
  for (size_t i = 0; i < rows.size(); ++i) recent_.Add(rows[i], pixels[i]);
  uint32_t frames_durable = 0;
  {
    MutexLock lock(mutex_);
    for (const FrameRecord& row : rows) {
      durable_[static_cast<size_t>(row.camera)] = row.sequence;
      const auto pending = pending_.find(KeyOf(row.camera, row.shot));
      if (pending != pending_.end() && pending->second == row.sequence) pending_.erase(pending);
    }
    summary_.frames_durable += static_cast<uint32_t>(rows.size());
    frames_durable = summary_.frames_durable;
    changed_.NotifyAll();
  }
  MutexLock lock(listener_mutex_);
  if (on_durable_) on_durable_(frames_durable);
}

void StoredSession::OnStorageChange(const Status& status) {
  MutexLock lock(listener_mutex_);
  if (on_storage_) on_storage_(status);
}

// Through a connection of its own: the writer's is its thread's.
Status StoredSession::WriteEnd(SessionSummary ended, const JournalEntry& entry,
                               bool must_be_written) {
  auto ledger = Ledger::Open(folder_.journal(), faults_);
  Status written = ledger.ok() ? (*ledger)->WriteEnd(ended, entry) : ledger.status();
  if (!written.ok() && must_be_written && absl::IsUnavailable(written)) return written;
  const Status closed = writer_->Close();
  writer_.reset();
  recent_.Clear();
  ReturnFreedFrames();
  lock_ = UniqueFd();
  if (written.ok()) written = (*ledger)->Checkpoint();
  if (!written.ok() && ended.end == SessionEnd::kIncomplete && closed.ok()) {
    ended.reason = std::string(Message(written));
  }
  MutexLock lock(mutex_);
  ended.frames_durable = summary_.frames_durable;
  summary_ = ended;
  changed_.NotifyAll();
  return closed.ok() ? written : closed;
}

Status StoredSession::Finish(bool complete, std::string_view reason, double virtual_s,
                             double wall_s, bool deterministic) {
  if (!writer_) return NotWriting();
  complete = complete || stays_complete_;
  Status status = writer_->Flush();
  if (complete && absl::IsUnavailable(status)) return status;
  if (status.ok() && complete) {
    const auto verify = [&](const FrameRecord& row) {
      ++verified_;
      return segments_.Read(row).status();
    };
    auto ledger = Ledger::Open(folder_.journal(), faults_);
    status = ledger.ok() ? Reconcile(plan_, rig_, **ledger, verify) : ledger.status();
    if (absl::IsUnavailable(status)) return status;
    status = Annotate(status, fmt::format("session {}", id_));
  }
  SessionSummary ended = Summary();
  ended.end = complete && status.ok() ? SessionEnd::kComplete : SessionEnd::kIncomplete;
  if (ended.end == SessionEnd::kIncomplete) {
    // What went wrong stands as the reason.
    ended.reason = status.ok() ? std::string(reason) : std::string(Message(status));
  }
  if (!std::isfinite(virtual_s)) virtual_s = 0;
  ended.virtual_s = before_.virtual_s + virtual_s;
  ended.wall_s = before_.wall_s + (std::isfinite(wall_s) ? wall_s : 0);
  ended.deterministic = before_.deterministic && deterministic;
  const JournalEntry entry{JournalKind::kEnded, began_rig_ns_ + std::llround(virtual_s * 1e9), -1,
                           0, ended.end == SessionEnd::kComplete ? "complete" : ended.reason};
  const Status written = WriteEnd(std::move(ended), entry, complete);
  return status.ok() ? written : status;
}

}  // namespace mesorig::daemon
