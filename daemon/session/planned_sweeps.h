#pragma once
// The sweeps of a compiled plan, by number and by shot: which frames belong to which sweep, and in
// which of its camera's segments a frame is kept (docs/files.md).

#include <cstdint>
#include <vector>

#include "protocol/plan/plan.h"

namespace mesorig::daemon {

struct PlannedSweep {
  uint32_t sweep = 0;                   // Sweep::index
  uint32_t first_shot = 0, frames = 0;  // shots first_shot .. first_shot + frames - 1
  bool keep_frames = true;
  std::vector<int> cameras;
  uint32_t segment() const { return sweep + 1; }  // of a sweep whose frames are not kept
};

// Immutable; any thread.
class PlannedSweeps {
 public:
  PlannedSweeps() = default;
  explicit PlannedSweeps(const CompiledPlan& plan);
  // Owned by this; null for a sweep that the plan lacks, or a shot that belongs to none.
  const PlannedSweep* Find(uint32_t sweep) const;
  const PlannedSweep* OfShot(uint32_t shot) const;
  // Where this camera's frame goes: sweep + 1 for one that the plan has and does not keep, else 0.
  uint32_t SegmentOf(int camera, uint32_t shot) const;

 private:
  std::vector<PlannedSweep> sweeps_;  // by first_shot
};

// A plan whose steps do not fit its own totals or the rig is a bug of its maker, but no reason to
// crash while counting its frames. InvalidArgument names plan and shot.
Status CheckPlan(const CompiledPlan& plan, const Rig& rig);

}  // namespace mesorig::daemon
