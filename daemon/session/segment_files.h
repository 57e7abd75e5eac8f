#pragma once
// All segment files of a session: a main one a camera, and one a camera and sweep for frames that
// the plan does not keep. Those of sweeps come and go: writers close them with the sweep, readers
// open them when they are asked for.

#include <cstdint>
#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "daemon/session/planned_sweeps.h"
#include "daemon/session/segment.h"
#include "daemon/session/session_folder.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

// By camera and segment: where the last record that counts ends.
using SegmentEnds = std::map<std::pair<int, uint32_t>, uint64_t>;

// Owned and called by one thread (the session's writer). Unavailable names the file and what
// failed; the same call may be made again.
class SegmentWriters {
 public:
  // Opens the main segments; what lies beyond `ends` is cut off, of those of sweeps when they are
  // opened. `sweeps` and `faults` (may be null) are borrowed for life.
  static StatusOr<SegmentWriters> Open(const SessionFolder& folder,
                                       std::vector<std::string> cameras,
                                       const PlannedSweeps& sweeps, SegmentEnds ends = {},
                                       DiskFaults* faults = nullptr);
  // Writes into the segment `record.segment`, which it creates when it is not there; returns the
  // record's offset.
  StatusOr<uint64_t> Append(const FrameRecord& record, std::string_view pixels);
  // Brings to the disk what was appended, new files included. Closes the segments of sweeps that
  // have their last planned frame, or whose camera has gone on to another segment; a frame that is
  // shot again opens it again. After an error, Rewind, and append again what this should have
  // synced.
  Status Sync();
  // Goes back to what the last Sync brought to the disk.
  void Rewind();
  size_t open_files() const { return files_.size(); }

 private:
  struct File {
    SegmentWriter writer;
    bool is_dirty = false, is_done = false;
  };
  using Key = std::pair<int, uint32_t>;  // camera, segment

  SegmentWriters(SessionFolder folder, std::vector<std::string> cameras,
                 const PlannedSweeps& sweeps, SegmentEnds ends, DiskFaults* faults)
      : folder_(std::move(folder)),
        cameras_(std::move(cameras)),
        sweeps_(&sweeps),
        faults_(faults),
        ends_(std::move(ends)) {}
  StatusOr<File*> Get(const Key& key);

  SessionFolder folder_;
  std::vector<std::string> cameras_;  // names
  const PlannedSweeps* sweeps_;
  DiskFaults* faults_;
  SegmentEnds ends_;  // synced
  std::map<Key, File> files_;
  bool has_new_main_ = false, has_new_sweep_ = false;  // their folders are to be synced
};

// Any thread.
class SegmentReaders {
 public:
  static constexpr size_t kMaxOpenSweepSegments = 16;

  // Opens the main segments: a lost one costs its frames. Which sweeps are released, the marks in
  // the folder tell, also those that come later: somebody who opened the session before it was
  // resumed may release beside its writer.
  SegmentReaders(const SessionFolder& folder, std::string session_id,
                 std::vector<std::string> cameras);
  // Again, when a writer may have made one that was lost. Before anybody else reads.
  void OpenMain();
  // Null for a frame of a released sweep. DataLoss names file and frame; Unavailable.
  StatusOr<std::shared_ptr<const std::string>> Read(const FrameRecord& record) EXCLUDES(mutex_);
  // From now on its frames are released, and none of its files is held open here.
  void Release(uint32_t sweep) EXCLUDES(mutex_);
  bool IsReleased(uint32_t segment) EXCLUDES(mutex_);
  // Numbers of sweeps, as far as known.
  std::set<uint32_t> Released() const EXCLUDES(mutex_);

 private:
  using Reader = std::shared_ptr<const SegmentReader>;  // shared: closed while another reads
  struct OpenSegment {
    int camera;
    uint32_t segment;
    Reader reader;
  };
  // Null for a released sweep.
  StatusOr<Reader> Get(const FrameRecord& record) EXCLUDES(mutex_);
  void ReleaseLocked(uint32_t segment) REQUIRES(mutex_);
  bool IsReleasedLocked(uint32_t segment) REQUIRES(mutex_);
  Status Lost(const FrameRecord& record, const Status& status) const;

  const SessionFolder folder_;
  const std::string session_id_;
  const std::vector<std::string> cameras_;  // names
  std::vector<StatusOr<Reader>> main_;      // one a camera
  mutable Mutex mutex_;
  std::list<OpenSegment> open_ GUARDED_BY(mutex_);  // of sweeps, the last used first
  std::set<uint32_t> released_ GUARDED_BY(mutex_);  // segments
};

}  // namespace mesorig::daemon
