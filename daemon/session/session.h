#pragma once
// One capture session on disk. docs/files.md tells the layout.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "protocol/base/disk_faults.h"
#include "protocol/base/status.h"
#include "protocol/plan/plan.h"
#include "protocol/plan/shot_selection.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

// Where in a sweep of the laser a frame stands (docs/laser.md).
struct LaserRecord {
  uint32_t sweep = 0, index = 0;  // Sweep::index of the plan; the frame within it
  int mount = 0;                  // index into Laser::mounts
  double tilt_rad = 0;            // by the tachometer
  bool on = false;                // laser_on, read back
};

// A row of the frame ledger: planned shot <-> trigger <-> camera frame <-> time <-> digest.
struct FrameRecord {
  uint64_t sequence = 0;  // counts this camera's rows from 1; assigned by Append
  int camera = 0;
  uint32_t shot = 0, trigger_id = 0;
  uint64_t frame_id = 0, supersedes = 0;
  int64_t exposure_start_ns = 0, exposure_end_ns = 0;
  double exposure_s = 0;
  std::vector<double> axis_rad, lamp_level;  // read back
  int width = 0, height = 0, bits = 0;       // of the region that was read
  int region_x = 0, region_y = 0;            // its origin on the sensor
  std::optional<LaserRecord> laser;          // frames of a sweep only
  std::string digest;                        // XXH3-128 of the pixels; computed by Append
  uint32_t segment = 0;                      // of the camera; assigned by Append
  uint64_t offset = 0, bytes = 0;            // in that segment; assigned by Append
  uint32_t run = 0;  // 0: of the first start, then of each resume; assigned by Append. Triggers,
                     // frame ids and rig time begin anew with a run.
};

struct StoredFrame {
  FrameRecord record;
  std::shared_ptr<const std::string> pixels;
};

// What a session's journal holds beside its frames, in order of time.
enum class JournalKind : uint8_t {
  kBegan = 1,    // the first start
  kResumed = 2,  // a later one, after a kill or an end that was incomplete
  kPaused = 3,
  kContinued = 4,  // after a pause, or an operator's visit
  kPrompt = 5,
  kRecovered = 6,  // a device was gone and came back
  kExposure = 7,   // metering chose `value` s for the meter `index`
  kReference = 8,  // after a resume: relative difference `value` to the frame taken before
  kAlarm = 9,      // a picture that somebody should look at; `index`: the camera
  kNote = 10,
  kEnded = 11,
};
struct JournalEntry {
  JournalKind kind{};
  int64_t rig_ns = 0;  // rig time
  int index = -1;
  double value = 0;
  std::string text;
};

enum class SessionEnd { kOpen, kComplete, kIncomplete };

struct SessionSummary {
  std::string id, plan_name, plan_sha256, rig_sha256;
  std::string sample_name, sample_sha256;  // empty in journals of versions 1 and 2
  uint32_t starts = 1;                     // the first and every resume
  SessionEnd end = SessionEnd::kOpen;
  std::string reason;  // when incomplete
  bool deterministic = true;
  double virtual_s = 0, wall_s = 0;  // of all runs that reached an end
  uint32_t frames_planned = 0, frames_durable = 0;
};

struct SessionOptions {
  // Of Resume: frames that are there and are to be taken again. Missing tells them, and what comes in
  // their place supersedes them; until then, and after a kill, the ones that are there count.
  ShotSelection again = {};
  // Append blocks while more pixels than this are not durable.
  size_t max_queued_bytes = size_t{256} << 20;
  DiskFaults* faults = nullptr;  // of tests; borrowed, outlives the session
};

// The newest frame of a camera, durable or not.
struct LiveFrame {
  StoredFrame frame;
  uint64_t count = 0;  // frames that this camera has given so far, this one included
};

// Thread contract: Append, Flush and Finish from the sequencer's thread; everything else from any
// thread. Never blocks on consumers. Destroyed without Finish, it commits what was appended and
// leaves the end open, as a kill does.
class Session {
 public:
  // Creates `<root>/<id>/`. The id is made of time and plan name, unique below root.
  static StatusOr<std::shared_ptr<Session>> Create(const std::filesystem::path& root,
                                                   const CompiledPlan& plan, const Rig& rig,
                                                   SessionOptions options = {});
  // Opens an ended (or killed) one for reading; of a killed one what was committed is readable.
  // NotFound; DataLoss for a journal, plan.bin or rig.toml that is not as it was written;
  // FailedPrecondition for another version of the format. Goes on with removing what was released.
  static StatusOr<std::shared_ptr<Session>> Open(const std::filesystem::path& root,
                                                 const std::string& id);
  // Opens one that was killed or ended incomplete, or a complete one of which frames are to be taken
  // again, to go on writing it: what is durable stays, torn tails are cut off, its end is open
  // again. InvalidArgument when its rig is not `rig` (digest); FailedPrecondition when it is complete
  // and nothing is wanted again, when such a frame's sweep was released, or somebody writes it;
  // otherwise as Open. A refusal leaves it as it was. Takes time for reading the journal, none for
  // the frames.
  static StatusOr<std::shared_ptr<Session>> Resume(const std::filesystem::path& root,
                                                   const std::string& id, const Rig& rig,
                                                   SessionOptions options = {});
  virtual ~Session() = default;

  virtual const std::string& id() const = 0;
  virtual const std::string& rig_toml() const = 0;
  virtual const std::string& plan_bin() const = 0;
  virtual SessionSummary Summary() const = 0;

  // Queues the frame for its camera's segment; durable (acknowledged) within 100 ms of host time.
  // A frame of a shot that has a row already supersedes it. A failure that no waiting mends (a
  // damaged journal) comes back here: the session is then broken. Blocks, in host time, while
  // SessionOptions::max_queued_bytes wait for a slow disk; as the caller is a rig thread, virtual
  // time stands still meanwhile. ResourceExhausted when so much waits and the disk takes nothing
  // (Storage): this frame is not kept, and Missing tells it. InvalidArgument for a camera that the
  // rig lacks, figures that are not finite, or pixels that are not width x height of `bits` bits;
  // FailedPrecondition for a frame of a released sweep.
  virtual Status Append(FrameRecord record, std::shared_ptr<const std::string> pixels) = 0;
  // Cameras of a planned shot that have no live frame: none appended, or what was is damaged.
  // Ascending. Any number of calls a shot: costs nothing. (The session keeps two bits a camera and
  // shot for it.) Of a session opened for reading: none.
  virtual std::vector<int> Missing(uint32_t shot) const = 0;
  // Journals; durable with the next group of frames, or the next Flush. InvalidArgument for a value
  // that is not finite; otherwise errors as Append.
  virtual Status Record(JournalEntry entry) = 0;
  // What metering chose for this meter, in this run or before a kill.
  virtual std::optional<double> MeteredExposure(int meter) const = 0;
  // The last durable lamp frame of the sample (Purpose::kData, not of a sweep) whose pixels are
  // whole; nothing: there is none.
  virtual StatusOr<std::optional<StoredFrame>> Reference() = 0;
  // Reads every live frame again after a Flush. Damaged ones are no longer live: Missing tells
  // them, and the frame that comes in their place supersedes them. Returns how many there were.
  virtual StatusOr<uint32_t> DropDamaged() = 0;
  // OK, or why the disk takes nothing at the moment (Unavailable: file, operation, reason, bytes
  // that wait): full, read-only, failing. What was appended waits in memory and is tried again
  // twice a second; the sequencer pauses until it is OK again. The listener hears changes, on the
  // writer's thread; one.
  virtual Status Storage() const = 0;
  virtual void OnStorage(std::function<void(const Status&)> listener) = 0;
  // Frames that were appended and are not durable yet; and how many were read again so far by
  // DropDamaged and Finish: a sign of life where reading takes minutes.
  virtual size_t FramesQueued() const = 0;
  virtual uint64_t FramesVerified() const = 0;
  // Returns when everything appended is durable. Unavailable when the disk takes nothing, after one
  // more attempt: everything still waits.
  virtual Status Flush() = 0;
  // Reconciles (planned shots = triggers, frames = sum of cameras, all in the ledger, digests of
  // what is on disk checked) and writes the end. DataLoss when the ledger does not balance: the
  // end is then incomplete, with that reason. Only an end asked for as complete is reconciled.
  // Unavailable when the disk takes nothing: a complete end is then not written, the session goes
  // on, and Finish may be called again; an incomplete one ends what is in memory, and what waited
  // is missing when it is resumed. One that was complete, and was resumed to take frames again, ends
  // complete in any case: what was not taken again is still there.
  virtual Status Finish(bool complete, std::string_view reason, double virtual_s, double wall_s,
                        bool deterministic) = 0;
  // The camera's newest frame when it has given more than `after`, durable or not; waits at most
  // `wait_ms` of host time for it. Nothing for a session that is only read. Holds nobody up.
  virtual std::optional<LiveFrame> Latest(int camera, uint64_t after, int wait_ms) = 0;
  // What was journaled and is durable, in order of time.
  virtual StatusOr<std::vector<JournalEntry>> Entries() = 0;

  // Committed rows only. Waits at most `wait_ms` of host time for a row with a sequence above
  // `cursor`; nothing: none yet, or no more (see Summary().end). DataLoss names the file and the
  // frame that is damaged; the ones after it are still to be had.
  virtual StatusOr<std::optional<StoredFrame>> Next(int camera, uint64_t cursor, int wait_ms) = 0;
  // Deletes the raw frames of a sweep; ledger rows and digests stay, and Next passes over them.
  // Returns the bytes freed (0 when they were gone already). FailedPrecondition unless the plan
  // says so of this sweep and all its frames are durable; NotFound for a sweep that the plan lacks;
  // DataLoss when frames of it were lost before; Unavailable when a file cannot be removed (the
  // sweep may be released then, and another call goes on).
  virtual StatusOr<uint64_t> ReleaseSweep(uint32_t sweep) = 0;
  // Called after each group commit with the number of durable frames; one listener.
  virtual void OnDurable(std::function<void(uint32_t frames_durable)> listener) = 0;
};

// Ids below root, oldest first.
StatusOr<std::vector<std::string>> ListSessions(const std::filesystem::path& root);

}  // namespace mesorig::daemon
