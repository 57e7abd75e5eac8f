#pragma once
// Is this the frame that was asked for? Pure; reentrant.

#include <cstdint>
#include <string>

#include "daemon/device/camera.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

struct ExpectedFrame {
  uint32_t trigger_id = 0;
  RigTime triggered_at{}, deadline{};  // the frame is late after it
  uint64_t last_frame_id = 0;          // of this camera since it was opened; 0: none
  Region region;
};

// OK, or DataLoss that names the camera and what is wrong: of another trigger, a frame that was
// there already (camera's own count), stale (its exposure began before the trigger), from the
// future (its exposure begins after the deadline: the camera's clock jumped), exposed later than the
// camera's trigger_latency_s permits (the rig moves on after that), late (delivered at
// `now`, after the deadline), or torn (not region x bytes a pixel).
Status CheckFrame(const mesorig::Camera& camera, const ExpectedFrame& expected,
                  const CapturedFrame& frame, RigTime now);

}  // namespace mesorig::daemon
