#pragma once
// All cameras of the rig as one: settings, warm-up, one trigger in one instant, and what came of
// it.

#include <functional>
#include <vector>

#include "daemon/control/run_context.h"

namespace mesorig::daemon {

// Of one run, on the sequencer's thread.
class CameraArray {
 public:
  // A camera that took no frame for so long warms up before the next one.
  static constexpr double kIdle_s = 10;

  explicit CameraArray(const RunContext& context);  // borrowed; triggers count from 1

  // Opens all; what they were set to is forgotten, and all are cold. The camera's error.
  Status Open();
  // Somebody was at the rig, or time stood still: all are cold.
  void Chill();
  // Sets those of `cameras` that have other settings. `regions`: one a camera; empty: whole
  // sensors.
  Status Configure(const std::vector<int>& cameras, double exposure_s,
                   const std::vector<Region>& regions, uint32_t repeat);
  // The first frame after opening or idling is lost, or not to be trusted (aravis 818): those of
  // `cameras` that are cold take one that is thrown away.
  Status WarmUp(const std::vector<int>& cameras);

  // All of them, in one instant.
  Status Trigger(const std::vector<int>& cameras);
  RigTime triggered_at() const { return triggered_at_; }
  // The latest instant at which the frames of the last trigger may come.
  RigTime Deadline(const std::vector<int>& cameras) const;
  // When nothing is exposed any more.
  RigTime ExposureEnd(const std::vector<int>& cameras) const;

  using Take = std::function<Status(int camera, const CapturedFrame& frame)>;
  // The frames of the last trigger. Good ones go to `take`, whose error ends it; `cameras` are left
  // with those whose frame did not come, or was not the one that was asked for: `missing` says why,
  // and each is noted. Cancelled: the StopFlag is up.
  Status Collect(RigTime deadline, std::vector<int>& cameras, Status& missing, const Take& take);

  const Region& region(int camera) const { return states_[camera].setting.region; }

 private:
  struct Setting {
    double exposure_s = 0;  // 0: not configured
    Region region;
    uint32_t repeat = 0;
    friend bool operator==(const Setting&, const Setting&) = default;
  };
  struct State {
    Setting setting;
    bool cold = true;
    RigTime used_at{};
    uint64_t last_frame_id = 0, dropped = 0;
  };
  bool IsCold(int camera) const;
  StatusOr<CapturedFrame> TakeFrame(int camera, RigTime deadline);
  void NoteDropped(int camera);

  const RunContext& context_;
  std::vector<State> states_;
  uint32_t last_trigger_ = 0;
  RigTime triggered_at_{};
};

}  // namespace mesorig::daemon
