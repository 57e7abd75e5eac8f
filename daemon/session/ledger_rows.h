#pragma once
// A row of the frame ledger and its columns in SQLite. Private to this folder.

#include "daemon/session/session.h"

struct sqlite3_stmt;

namespace mesorig::daemon {

// In the order of BindFrame and ReadFrame.
inline constexpr char kFrameColumns[] =
    "camera, sequence, shot, trigger_id, frame_id, supersedes, exposure_start_ns, "
    "exposure_end_ns, exposure_s, axis_rad, lamp_level, width, height, bits, region_x, region_y, "
    "laser_sweep, laser_index, laser_mount, laser_tilt_rad, laser_on, digest, segment, offset, "
    "bytes, run";
inline constexpr int kFrameColumnCount = 26;

void BindFrame(sqlite3_stmt* statement, const FrameRecord& record);
FrameRecord ReadFrame(sqlite3_stmt* row);

}  // namespace mesorig::daemon
