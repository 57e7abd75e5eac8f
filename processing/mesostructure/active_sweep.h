#pragma once
// Internal to processing/mesostructure: one (camera, sweep) whose frames are coming.

#include <array>
#include <string>
#include <string_view>

#include "processing/mesostructure/mdf_builder.h"

namespace mesorig::mesostructure {

// Owned by its slot, used under the camera's mutex.
class ActiveSweep {
 public:
  // As SweepGeometry::Build. Everything is borrowed.
  static StatusOr<std::unique_ptr<ActiveSweep>> Begin(const Rig& rig, const CompiledPlan& plan,
                                                      const Step& step, const SweepFrame& first,
                                                      const Region& region);
  // Keeps what is needed of the frame's pixels. FailedPrecondition: they are left out, or show no
  // plane of the laser. InvalidArgument: malformed.
  Status Add(const SweepFrame& frame, std::string_view pixels);
  // Frames of the sweep that have come, usable or not.
  size_t arrived() const { return arrived_; }
  bool whole() const { return arrived_ == sequences_.size(); }
  // Of the frame `index`; 0: none yet.
  uint64_t sequence_of(uint32_t index) const { return sequences_[index]; }
  uint64_t newest() const;
  const SweepGeometry& geometry() const { return geometry_; }
  StatusOr<Displacement> Compute() const;

 private:
  ActiveSweep(const Rig& rig, const CompiledPlan& plan, const Step& step, SweepGeometry geometry,
              const SweepFrame& first);
  Status CheckState(const SweepFrame& frame) const;

  const Rig& rig_;
  const CompiledPlan& plan_;
  const SweepGeometry geometry_;
  const Camera camera_;                 // with the region's size
  const std::vector<double> axis_rad_;  // of the first frame
  const CodeScale scale_;
  std::array<float, 3> gain_{};  // of each colour to the laser's strongest; 0: not used
  FrameStack stack_;
  std::vector<std::optional<TiltFix>> fixes_;
  std::vector<uint64_t> sequences_;
  size_t arrived_ = 0;
};

}  // namespace mesorig::mesostructure
