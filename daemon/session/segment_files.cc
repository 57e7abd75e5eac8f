#include "daemon/session/segment_files.h"

#include <algorithm>

#include "daemon/session/released_sweeps.h"

namespace mesorig::daemon {

StatusOr<SegmentWriters> SegmentWriters::Open(const SessionFolder& folder,
                                              std::vector<std::string> cameras,
                                              const PlannedSweeps& sweeps, SegmentEnds ends,
                                              DiskFaults* faults) {
  SegmentWriters writers(folder, std::move(cameras), sweeps, std::move(ends), faults);
  for (size_t i = 0; i < writers.cameras_.size(); ++i) {
    MESORIG_RETURN_IF_ERROR(writers.Get({static_cast<int>(i), 0}).status());
  }
  return writers;
}

StatusOr<SegmentWriters::File*> SegmentWriters::Get(const Key& key) {
  const auto found = files_.find(key);
  if (found != files_.end()) return &found->second;
  const std::string& camera = cameras_[static_cast<size_t>(key.first)];
  const auto end = ends_.find(key);
  MESORIG_ASSIGN_OR_RETURN(
      SegmentWriter writer,
      SegmentWriter::Open(folder_.segment(camera, key.second), key.first, camera,
                          end == ends_.end() ? 0 : end->second, faults_));
  // (An earlier attempt may have created it and failed at its header.)
  const bool sync_folder = writer.is_new() || end == ends_.end();
  (key.second == 0 ? has_new_main_ : has_new_sweep_) |= sync_folder;
  ends_[key] = writer.end();
  return &files_.emplace(key, File{std::move(writer)}).first->second;
}

StatusOr<uint64_t> SegmentWriters::Append(const FrameRecord& record, std::string_view pixels) {
  const Key key{record.camera, record.segment};
  MESORIG_ASSIGN_OR_RETURN(File* const file, Get(key));
  MESORIG_ASSIGN_OR_RETURN(const uint64_t offset, file->writer.Append(record.sequence, record.shot,
                                                                      record.digest, pixels));
  file->is_dirty = true;
  for (auto at = files_.lower_bound({record.camera, 1});
       at != files_.end() && at->first.first == record.camera; ++at) {
    at->second.is_done = at->first != key;
  }
  if (const PlannedSweep* sweep = sweeps_->OfShot(record.shot); key.second != 0 && sweep) {
    file->is_done = record.shot - sweep->first_shot + 1 == sweep->frames;
  }
  return offset;
}

Status SegmentWriters::Sync() {
  for (auto& [key, file] : files_) {
    if (file.is_dirty) MESORIG_RETURN_IF_ERROR(file.writer.Sync());
    file.is_dirty = false;
  }
  if (has_new_main_) MESORIG_RETURN_IF_ERROR(SyncFolder(folder_.dir(), faults_));
  has_new_main_ = false;
  if (has_new_sweep_) MESORIG_RETURN_IF_ERROR(SyncFolder(folder_.sweeps(), faults_));
  has_new_sweep_ = false;
  for (const auto& [key, file] : files_) ends_[key] = file.writer.end();
  std::erase_if(files_, [](const auto& entry) { return entry.second.is_done; });
  return OkStatus();
}

void SegmentWriters::Rewind() {
  for (auto& [key, file] : files_) file.writer.Rewind(ends_[key]);
}

SegmentReaders::SegmentReaders(const SessionFolder& folder, std::string session_id,
                               std::vector<std::string> cameras)
    : folder_(folder), session_id_(std::move(session_id)), cameras_(std::move(cameras)) {
  OpenMain();
  MutexLock lock(mutex_);
  for (const uint32_t sweep : FindReleased(folder_, session_id_)) released_.insert(sweep + 1);
}

void SegmentReaders::OpenMain() {
  main_.clear();
  for (const std::string& camera : cameras_) {
    auto reader = SegmentReader::Open(folder_.segment(camera));
    if (reader.ok()) {
      main_.emplace_back(std::make_shared<const SegmentReader>(*std::move(reader)));
    } else {
      main_.emplace_back(reader.status());
    }
  }
}

void SegmentReaders::Release(uint32_t sweep) {
  MutexLock lock(mutex_);
  ReleaseLocked(sweep + 1);
}

void SegmentReaders::ReleaseLocked(uint32_t segment) {
  released_.insert(segment);
  open_.remove_if([&](const OpenSegment& open) { return open.segment == segment; });
}

bool SegmentReaders::IsReleased(uint32_t segment) {
  MutexLock lock(mutex_);
  return IsReleasedLocked(segment);
}

bool SegmentReaders::IsReleasedLocked(uint32_t segment) {
  if (segment == 0) return false;
  if (!released_.contains(segment) && IsMarkedReleased(folder_, session_id_, segment - 1)) {
    ReleaseLocked(segment);
  }
  return released_.contains(segment);
}

std::set<uint32_t> SegmentReaders::Released() const {
  std::set<uint32_t> sweeps;
  MutexLock lock(mutex_);
  for (const uint32_t segment : released_) sweeps.insert(segment - 1);
  return sweeps;
}

// What the ledger speaks of and the disk does not have.
Status SegmentReaders::Lost(const FrameRecord& record, const Status& status) const {
  std::error_code error;
  std::string mark;
  if (record.segment > 0) {
    const std::filesystem::path path = folder_.release_mark(record.segment - 1);
    if (std::filesystem::exists(path, error)) {
      mark = fmt::format("; {} does not say that it was released", path.filename().string());
    }
  }
  return DataLoss("{} (frame {}, shot {}){}", Message(status), record.sequence, record.shot, mark);
}

StatusOr<SegmentReaders::Reader> SegmentReaders::Get(const FrameRecord& record) {
  if (record.camera < 0 || static_cast<size_t>(record.camera) >= cameras_.size()) {
    return DataLoss("frame {} (shot {}) is of camera {}, there are {}", record.sequence,
                    record.shot, record.camera, cameras_.size());
  }
  const auto camera = static_cast<size_t>(record.camera);
  if (record.segment == 0) {
    if (!main_[camera].ok()) return Lost(record, main_[camera].status());
    return main_[camera];
  }
  MutexLock lock(mutex_);
  if (released_.contains(record.segment)) return Reader();
  const auto found = std::find_if(open_.begin(), open_.end(), [&](const OpenSegment& open) {
    return open.camera == record.camera && open.segment == record.segment;
  });
  if (found != open_.end()) {
    open_.splice(open_.begin(), open_, found);
    return open_.front().reader;
  }
  auto opened = SegmentReader::Open(folder_.segment(cameras_[camera], record.segment));
  if (!opened.ok()) {
    if (IsReleasedLocked(record.segment)) return Reader();
    return Lost(record, opened.status());
  }
  open_.push_front(
      {record.camera, record.segment, std::make_shared<const SegmentReader>(*std::move(opened))});
  if (open_.size() > kMaxOpenSweepSegments) open_.pop_back();
  return open_.front().reader;
}

StatusOr<std::shared_ptr<const std::string>> SegmentReaders::Read(const FrameRecord& record) {
  MESORIG_ASSIGN_OR_RETURN(const Reader reader, Get(record));
  if (reader == nullptr) return std::shared_ptr<const std::string>();
  return reader->Read(record);
}

}  // namespace mesorig::daemon
