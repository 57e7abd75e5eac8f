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

// What came wrong since the camera was made. All but `lost` were frames, and were dropped.
struct FrameFaults {
  uint64_t lost = 0;       // triggers whose frame did not come until the deadline
  uint64_t late = 0;       // of an earlier trigger, which was given up
  uint64_t duplicate = 0;  // came before
  uint64_t torn = 0;       // rows are missing
  uint64_t damaged = 0;    // is not what the camera sent
  uint64_t stale = 0;      // names this trigger, but is an older picture by the camera's count
  uint64_t wrong_id = 0;   // names a trigger that was never given
  uint64_t mistimed = 0;   // exposed at another time than its trigger's, by the camera's clock
  uint64_t dropped() const {
    return late + duplicate + torn + damaged + stale + wrong_id + mistimed;
  }
};

// Owned and called by one rig thread.
class Camera {
 public:
  virtual ~Camera() = default;
  virtual const std::string& name() const = 0;
  // Finds the camera by its serial number and takes its clock's time. To be called again after an
  // error (Unavailable, or frames that do not come): what it had been told is told again by the next
  // Configure. Unavailable: it is not there, NotFound: the rig's wires have no such camera.
  virtual Status Open() = 0;
  // Takes effect for the next trigger, whose frame holds `region` of the sensor. `repeat_index` makes
  // noise of repeats differ in simulation. InvalidArgument for what the camera cannot do.
  virtual Status Configure(double exposure_s, const Region& region, uint32_t repeat_index) = 0;
  virtual Status Trigger(uint32_t trigger_id) = 0;
  // The frame of this trigger, whole, exposed at its time as it was configured. DeadlineExceeded
  // when it does not come until `deadline`: the message says what came instead, which is dropped and
  // counted. Unavailable: the camera is gone, or its frame is not as configured (Open it again).
  virtual StatusOr<CapturedFrame> Await(uint32_t trigger_id, RigTime deadline) = 0;
  virtual uint64_t dropped_frames() const = 0;
  virtual FrameFaults frame_faults() const { return {}; }
};

}  // namespace mesorig::daemon
