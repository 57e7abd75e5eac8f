#pragma once
// A session's frames to a sampled BTF (DESIGN, "BTF value"): the value of a texel is its radiance
// by its irradiance on a plane perpendicular to the light,
//   f(x, y, v, l) = L(x, y, v) / E(x, y),
// both at the texel's own distance and direction. Frames are kept apart in a work file, one slot a
// planned frame, and merged when the BTF is packed; so a frame that was shot again replaces its
// predecessor, and the result does not depend on the order of arrival.
//
// Ambient and dark frames tell the black level of each pixel (BlackLevels); flat frames are counted
// and not used. Frames of one view under one light are merged, those of several exposures by their
// variance (MergeExposures).

#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "processing/assemble/black_levels.h"
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
  uint32_t ambient = 0, dark = 0, flat = 0;  // of `frames`: no samples of the BTF
};

struct PackFigures {
  int views = 0, lights = 0;
  uint32_t pairs = 0;          // present
  uint32_t merged_frames = 0;  // frames beyond the first of their pair
  uint64_t clipped_texels = 0;  // lower bounds; of a merge of equal exposures each frame's
  uint64_t bytes = 0;           // of the file
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
  // Whether frames of this camera were developed with black levels that came to be others later (a
  // dark frame was shot again after them): these frames are to be added again, or their values
  // depend on the order of arrival. When no Add of this camera runs.
  bool NeedsAgain(int camera) const;
  // All but frames of laser sweeps, which are not for the assembler.
  uint32_t frames_planned() const { return frames_planned_; }
  static bool HasShots(const CompiledPlan& plan);
  // Shots that become values; a plan may have calibration frames only.
  static bool HasData(const CompiledPlan& plan);

  // FailedPrecondition when no frame is usable. `provenance_json` stands in the header.
  // The header's provenance stays empty; figures.bytes stays 0.
  StatusOr<btf::SampledBtf> BuildBtf(PackFigures& figures) const;
  // Writes `*.btf.exr` whole or not at all. Provenance: session, plan, sample, rig, rig_sha256,
  // plan_sha256, program, frames, frames_planned, frames_superseded, frames_refused, frames_merged,
  // texels_clipped; with calibration frames also frames_ambient, frames_dark, frames_flat.
  StatusOr<PackFigures> Pack(const std::filesystem::path& path, std::string_view session_id,
                             std::string_view audit_head = {}) const;

 private:
  struct Slot {
    int camera = 0;
    uint32_t shot = 0;
    Purpose purpose = Purpose::kData;
    size_t work = 0;        // kData: slot of the work file
    uint64_t sequence = 0;  // 0: nothing has arrived
    bool usable = false;
    std::string refusal;
    Vec3 camera_in_sample, lamp_in_sample;  // mm
    uint64_t clipped_texels = 0;
    uint64_t black_version = 0;  // of BlackLevels, when it was developed
    double exposure_s = 0;
    std::array<double, 3> irradiance{};  // mean over the texels
  };
  // The map of a camera's last pose: plans keep the turntable still for many shots.
  struct CameraState {
    Mutex mutex;
    RigidTransform sample_from_camera GUARDED_BY(mutex);
    std::optional<RectifyMap> map GUARDED_BY(mutex);
  };

  Assembler(Rig rig, CompiledPlan plan, WorkFile work, BlackLevels black);
  StatusOr<size_t> SlotFor(const FrameInfo& info) const;
  StatusOr<const RectifyMap*> MapFor(CameraState& state, int camera,
                                     const RigidTransform& sample_from_camera)
      REQUIRES(state.mutex);
  // Fills the slot's floats; FailedPrecondition means refused.
  Status Develop(CameraState& state, const FrameInfo& info, std::string_view pixels, Slot& slot)
      REQUIRES(state.mutex);
  // By the purpose of its shot.
  Status Take(CameraState& state, const FrameInfo& info, std::string_view pixels, Slot& slot)
      REQUIRES(state.mutex);
  // Of a slot of the work file: 3 values a texel; flags of saturation, one a texel, when the plan
  // has several exposures.
  std::span<float> Values(size_t work) const;
  std::span<uint8_t> Saturated(size_t work) const;
  // Merges slots of one view and light.
  void Merge(const std::vector<const Slot*>& slots, std::span<float> merged,
             PackFigures& figures) const;
  std::string Provenance(std::string_view session_id, std::string_view audit_head,
                         const PackFigures& figures) const;

  const Rig rig_;
  const CompiledPlan plan_;
  const btf::BtfHeader grid_;
  std::vector<size_t> first_slot_;       // of each shot
  std::vector<const Step*> shot_steps_;  // into plan_.steps; null: a frame of a sweep
  uint32_t frames_planned_ = 0;
  const bool has_brackets_;  // data of more than one exposure
  WorkFile work_;
  BlackLevels black_;
  std::vector<std::unique_ptr<CameraState>> cameras_;
  mutable Mutex mutex_;
  std::vector<Slot> slots_ GUARDED_BY(mutex_);
  uint32_t superseded_ GUARDED_BY(mutex_) = 0;
};

}  // namespace mesorig::assemble
