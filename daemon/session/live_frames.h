#pragma once
// Which planned frames are there. Costs two bits a camera and shot (8 cameras, 10^5 shots: 200 KB),
// and 12 bytes a step that shoots.

#include <cstdint>
#include <vector>

#include "protocol/plan/plan.h"

namespace mesorig::daemon {

// Not thread-safe. Cameras and shots that the rig and the plan lack are never there.
class LiveFrames {
 public:
  LiveFrames() = default;
  // The plan has passed CheckPlan for a rig of so many cameras.
  LiveFrames(const CompiledPlan& plan, int cameras);
  // The frame has a row, and is live.
  void Add(int camera, uint32_t shot);
  // It is not live any more: its row is to be superseded.
  void Drop(int camera, uint32_t shot);
  bool HasRow(int camera, uint32_t shot) const;
  bool IsLive(int camera, uint32_t shot) const;
  // Planned cameras of the shot without a live frame, ascending.
  std::vector<int> Missing(uint32_t shot) const;
  uint32_t shots() const { return shots_; }

 private:
  struct Stretch {                               // of shots that a step plans
    uint32_t first = 0, count = 0, cameras = 0;  // index into cameras_
  };
  bool Knows(int camera, uint32_t shot) const {
    return camera >= 0 && static_cast<size_t>(camera) < has_row_.size() && shot < shots_;
  }
  uint32_t shots_ = 0;
  std::vector<Stretch> stretches_;                    // by first
  std::vector<std::vector<int>> cameras_;             // different lists of cameras
  std::vector<std::vector<bool>> has_row_, is_live_;  // camera, shot
};

}  // namespace mesorig::daemon
