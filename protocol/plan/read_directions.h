#pragma once
// Internal to protocol/plan: axes, names and exposures as they stand in tables of a plan file.
// Errors are reported to the table; what is returned then is of no use.

#include <string_view>
#include <vector>

#include "protocol/base/toml_reader.h"
#include "protocol/plan/plan_source.h"

namespace mesorig {

// `t.axes.<name>` of every axis: `angles_deg`, or `start_deg`, `step_deg`, `count`. Ascending.
std::vector<std::vector<double>> ReadAxes(TomlTable& t, const Rig& rig);
// `t.axes_deg.<name>` of every axis: one angle each.
std::vector<double> ReadAxesAngles(TomlTable& t, const Rig& rig);

// Names under `key`; all of the rig's without it. Ascending.
std::vector<int> ReadLamps(TomlTable& t, const Rig& rig);
std::vector<int> ReadCameras(TomlTable& t, const Rig& rig);
std::vector<int> ReadMounts(TomlTable& t, const Rig& rig);

// One of `exposure_s`, `exposures_s` and `exposure = "auto"`, for shots under lamps.
Exposures ReadExposures(TomlTable& t, const Rig& rig, const std::vector<int>& cameras);
// Refuses what a camera cannot do and, under lamps, what is no whole half period of the mains.
void CheckExposure(TomlTable& t, std::string_view key, double exposure_s, const Rig& rig,
                   const std::vector<int>& cameras, bool under_lamps);
// Ascending: 1 to kMaxLadder of them, none twice.
void CheckExposureCount(TomlTable& t, std::string_view key, const std::vector<double>& exposures_s);
double ReadSettle(TomlTable& t);
uint32_t ReadRepeats(TomlTable& t);

}  // namespace mesorig
