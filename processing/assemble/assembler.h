#pragma once
// A session's frames to a sampled BTF (DESIGN, "BTF value"): the value of a texel is its radiance
// by its irradiance on a plane perpendicular to the light,
//   f(x, y, v, l) = L(x, y, v) / E(x, y),
// both at the texel's own distance and direction. Frames are kept apart in a work file, one slot a
// planned frame, and merged when the BTF is packed; so a frame that was shot again replaces its
// predecessor, and the result does not depend on the order of arrival.

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "processing/assemble/rectify_map.h"
#include "processing/assemble/work_file.h"
#include "processing/btf/sampled_btf.h"
#include "protocol/base/mutex.h"
#include "protocol/plan/plan.h"
#include "protocol/rig/rig.h"

namespace mesorig::assemble {

// What was read back with a frame.
struct FrameInfo {
  uint64_t sequence = 0;  // of its camera's ledger: the later one of two for one shot counts
  int camera = 0;
  uint32_t shot = 0;
  double exposure_s = 0;
  std::vector<double> axis_rad, lamp_level;
};

// InvalidArgument unless there is one finite reading of every axis and every lamp of the rig.
Status CheckReadings(const Rig& rig, const std::vector<double>& axis_rad,
                     const std::vector<double>& lamp_level);

struct Tally {
  uint32_t frames = 0;          // planned frames that have arrived
  uint32_t superseded = 0;      // frames that replaced an earlier one
  uint32_t refused = 0;         // of `frames`: not usable, their pair is absent
  std::string first_refusal;
  uint64_t clipped_texels = 0;  // texels of frames whose value is a lower bound (saturation)
};

struct PackFigures {
  int views = 0, lights = 0;
  uint32_t pairs = 0;          // present
  uint32_t merged_frames = 0;  // frames beyond the first of their pair
  uint64_t bytes = 0;          // of the file
};

// The product's texels, without directions.
btf::BtfHeader GridOf(const Product& product);

// Thread contract: Add from any thread, frames of one camera one after the other (others wait);
// BuildBtf and Pack when no Add runs. tally() from any thread.
class Assembler {
 public:
  // InvalidArgument for a plan that is not the rig's; otherwise as WorkFile::Create.
  static StatusOr<std::unique_ptr<Assembler>> Create(Rig rig, CompiledPlan plan,
                                                     const std::filesystem::path& work_file);
  // InvalidArgument: a frame that was not planned, or whose pixels or readings are malformed; it
  // names camera and shot. A frame that cannot become a BTF value (no lamp or several, a texel out
  // of the picture) is refused: counted in the tally, its pair stays absent. A frame that a later
  // one has replaced already is ignored.
  Status Add(const FrameInfo& info, std::string_view pixels);
  Tally tally() const;
  // Those of lamps; frames of laser sweeps are not for the assembler.
  uint32_t frames_planned() const { return frames_planned_; }
  static bool HasShots(const CompiledPlan& plan);

  // FailedPrecondition when no frame is usable. `provenance_json` stands in the header.
  // The header's provenance stays empty; figures.bytes stays 0.
  StatusOr<btf::SampledBtf> BuildBtf(PackFigures& figures) const;
  // Writes `*.btf.exr` whole or not at all. Provenance: session, plan, sample, rig, rig_sha256,
  // plan_sha256, program, frames, frames_planned, frames_superseded, frames_refused, frames_merged,
  // texels_clipped.
  StatusOr<PackFigures> Pack(const std::filesystem::path& path, std::string_view session_id) const;

 private:
  struct Slot {
    int camera = 0;
    uint32_t shot = 0;
    uint64_t sequence = 0;  // 0: nothing has arrived
    bool usable = false;
    std::string refusal;
    Vec3 camera_in_sample, lamp_in_sample;  // mm
    uint64_t clipped_texels = 0;
  };
  // The map of a camera's last pose: plans keep the turntable still for many shots.
  struct CameraState {
    Mutex mutex;
    RigidTransform sample_from_camera GUARDED_BY(mutex);
    std::optional<RectifyMap> map GUARDED_BY(mutex);
  };

  Assembler(Rig rig, CompiledPlan plan, WorkFile work);
  StatusOr<size_t> SlotFor(const FrameInfo& info) const;
  StatusOr<const RectifyMap*> MapFor(CameraState& state, int camera,
                                     const RigidTransform& sample_from_camera)
      REQUIRES(state.mutex);
  // Fills the slot's floats; FailedPrecondition means refused.
  Status Develop(CameraState& state, const FrameInfo& info, std::string_view pixels,
                 std::span<float> values, Slot& slot) REQUIRES(state.mutex);
  std::string Provenance(std::string_view session_id, const PackFigures& figures) const;

  const Rig rig_;
  const CompiledPlan plan_;
  const btf::BtfHeader grid_;
  std::vector<size_t> first_slot_;       // of each shot
  std::vector<const Step*> shot_steps_;  // into plan_.steps; null: a frame of a sweep
  uint32_t frames_planned_ = 0;
  WorkFile work_;
  std::vector<std::unique_ptr<CameraState>> cameras_;
  mutable Mutex mutex_;
  std::vector<Slot> slots_ GUARDED_BY(mutex_);
  uint32_t superseded_ GUARDED_BY(mutex_) = 0;
};

}  // namespace mesorig::assemble
