#pragma once
// The plots of a report. Each returns NotFound, with the reason, when the figures that it shows are
// not there.

#include <filesystem>
#include <nlohmann/json_fwd.hpp>

#include "protocol/base/status.h"

namespace mesorig::report {

// btf.by_view_theta and btf.by_light_theta: PSNR against polar angle.
Status PlotErrorByAngle(const nlohmann::json& report, const std::filesystem::path& png);
// codec.sweep: PSNR and encoding time against terms; PSNR against size.
Status PlotSweep(const nlohmann::json& report, const std::filesystem::path& png);
// stages: wall time of each.
Status PlotStages(const nlohmann::json& report, const std::filesystem::path& png);

}  // namespace mesorig::report
