#pragma once
// Chooses an exposure by looking: every exposure of a ladder is shot once, and the one with the
// fewest saturated and dark pixels over all cameras is taken, of equals the longest. What is shot
// here is thrown away: no frame of the ledger.

#include <vector>

#include "daemon/control/camera_array.h"
#include "daemon/control/run_context.h"
#include "daemon/control/shot_book.h"

namespace mesorig::daemon {

// Pure. `bad_pixels`: saturated plus dark, one per exposure of `ladder_s` (ascending, not empty).
double ChooseExposure(const std::vector<double>& ladder_s, const std::vector<size_t>& bad_pixels);

// The rig stands as the meter wants it. Journals its choice. Unavailable when frames do not come;
// else the device's or the session's error.
Status Meter(const RunContext& context, CameraArray& cameras, ShotBook& book, const Step& step);

}  // namespace mesorig::daemon
