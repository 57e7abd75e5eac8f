#pragma once
// A triggered camera.

#include <cstdint>
#include <memory>
#include <string>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

// One frame as the camera delivered it; immutable, moves by reference count.
struct CapturedFrame {
  uint32_t trigger_id = 0;
  uint64_t frame_id = 0;  // the camera's own count
  RigTime exposure_start{}, exposure_end{};
  int width = 0, height = 0, bits = 0;
  std::shared_ptr<const std::string> pixels;  // shared with the segment writer
};

// Owned and called by one rig thread.
class Camera {
 public:
  virtual ~Camera() = default;
  virtual const std::string& name() const = 0;
  virtual Status Open() = 0;
  // Takes effect for the next trigger, whose frame holds `region` of the sensor. `repeat_index` makes
  // noise of repeats differ in simulation. InvalidArgument for what the camera cannot do.
  virtual Status Configure(double exposure_s, const Region& region, uint32_t repeat_index) = 0;
  virtual Status Trigger(uint32_t trigger_id) = 0;
  // The frame of this trigger. DeadlineExceeded after `deadline`; a frame of another trigger is
  // dropped and counted.
  virtual StatusOr<CapturedFrame> Await(uint32_t trigger_id, RigTime deadline) = 0;
  virtual uint64_t dropped_frames() const = 0;
};

}  // namespace mesorig::daemon
