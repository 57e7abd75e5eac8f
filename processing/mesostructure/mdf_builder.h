#pragma once
// A session's frames of laser sweeps to the mesostructure distance function (docs/laser.md, "From
// frames to D"). Of each (camera, sweep) only the sample's pixels are kept until its frames are
// whole; then its displacement image is computed and written, durably, as a file of its own:
// `<folder>/sweep003_cam2.mdf.exr`, an MDF of one view whose confidence is the weight of
// Displacement. A later builder of the same plan takes up what it finds there.

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "processing/mesostructure/displacement.h"
#include "protocol/base/mutex.h"

namespace mesorig::mesostructure {

class ActiveSweep;

// What was read back with a frame of a sweep.
struct SweepFrame {
  uint64_t sequence = 0;  // of its camera's ledger: the later one of two for one shot counts
  int camera = 0;
  uint32_t shot = 0;
  double exposure_s = 0;
  std::vector<double> axis_rad, lamp_level;
  uint32_t sweep = 0, index = 0;
  int mount = 0;
  double tilt_rad = 0;  // of the tachometer: not used but for what people read
  bool on = false;      // laser_on, read back
  Region region;        // what the pixels are of
};

struct SweepTally {
  uint32_t frames = 0;  // planned frames that have arrived or need not come again
  uint32_t superseded = 0;
  uint32_t refused = 0;  // of `frames`: no plane was found in them, or they are unusable
  std::string first_refusal;
  uint32_t images = 0;        // displacement images that are durable
  uint32_t images_empty = 0;  // of these: nothing could be computed
  std::string first_empty;
};

struct MdfPackFigures {
  int views = 0;
  uint32_t images = 0;
  double coverage = 0;  // share of texels with confidence > 0, all views
  uint64_t bytes = 0;
};

// Thread contract: Add from any thread, frames of one camera one after the other (others wait);
// Build and Pack when no Add runs; the rest from any thread.
class MdfBuilder {
 public:
  // `folder` is created. InvalidArgument for a plan that is not the rig's, that has no sweep, or
  // for a rig without laser and turntable.
  static StatusOr<std::unique_ptr<MdfBuilder>> Create(Rig rig, CompiledPlan plan,
                                                      std::filesystem::path folder);
  ~MdfBuilder();
  // InvalidArgument: a frame that was not planned, or whose pixels or readings are malformed; it
  // names camera and shot. A frame that shows no plane of the laser is counted as refused; so is
  // one with the laser off, a lamp on or axes that are not those of its sweep's first frame: its
  // pixels are left out. Other errors: the displacement image cannot be written.
  Status Add(const SweepFrame& frame, std::string_view pixels);
  // Sweeps whose displacement images have become durable for all cameras since the last call and of
  // which something was computed: their raw frames may go, where the plan says so.
  std::vector<uint32_t> TakeReleasable();
  SweepTally tally() const;
  uint32_t frames_planned() const { return frames_planned_; }
  static bool HasSweeps(const CompiledPlan& plan);

  // Sweeps that are not whole are computed from what is there. FailedPrecondition when no
  // displacement image has a texel. The header's provenance stays empty; figures.bytes stays 0.
  StatusOr<btf::Mdf> Build(MdfPackFigures& figures);
  // Writes `*.mdf.exr` whole or not at all. Provenance: session, plan, sample, rig, rig_sha256,
  // plan_sha256, program, frames, frames_planned, frames_superseded, frames_refused, images,
  // images_empty.
  StatusOr<MdfPackFigures> Pack(const std::filesystem::path& path, std::string_view session_id,
                                std::string_view audit_head = {});

 private:
  struct Slot {  // one (sweep, camera)
    const Step* step = nullptr;
    int camera = 0;
    Region region;
    std::unique_ptr<ActiveSweep> active;  // while its frames are coming
    uint64_t durable_sequence = 0;  // of the newest frame that the durable image holds; 0: none
    bool empty = false;             // the durable image has no texel
    Vec3 camera_position;           // sample frame; of the durable image
  };

  MdfBuilder(Rig rig, CompiledPlan plan, std::filesystem::path folder);
  void TakeUp();
  StatusOr<size_t> SlotFor(const SweepFrame& frame) const;
  Status Take(Slot& slot, const SweepFrame& frame, std::string_view pixels);
  // Computes the displacement image of what has come and makes it durable.
  Status Finish(Slot& slot);
  void NoteDurable(const Slot& slot, const std::string& why_empty);
  StatusOr<btf::Mdf> MergeViews(const std::vector<const Slot*>& slots,
                                MdfPackFigures& figures) const;
  std::filesystem::path PathOf(const Slot& slot) const;
  std::string Provenance(std::string_view session_id, std::string_view audit_head) const;

  const Rig rig_;
  const CompiledPlan plan_;
  const std::string plan_sha256_;
  const std::filesystem::path folder_;
  uint32_t frames_planned_ = 0;
  std::vector<const Step*> steps_;                      // of the sweeps, by index
  std::vector<size_t> first_slot_;                      // of each sweep
  std::vector<std::unique_ptr<Mutex>> camera_mutexes_;  // held while one of its frames is computed
  std::vector<Slot> slots_;                             // each guarded by its camera's mutex
  mutable Mutex mutex_;                                 // taken after a camera's
  SweepTally tally_ GUARDED_BY(mutex_);
  std::vector<uint32_t> open_cameras_ GUARDED_BY(mutex_);  // of each sweep: not durable yet
  std::vector<uint8_t> computed_ GUARDED_BY(mutex_);       // of each sweep: any texel
  std::vector<uint32_t> releasable_ GUARDED_BY(mutex_);
};

}  // namespace mesorig::mesostructure
