#include "protocol/plan/fits_rig.h"

#include <algorithm>
#include <cmath>

namespace mesorig {
namespace {

Status CheckMove(const Step& step, const Rig& rig) {
  if (step.axis_rad.size() != rig.axes.size()) {
    return InvalidArgument("{} axis angles, the rig has {} axes", step.axis_rad.size(),
                           rig.axes.size());
  }
  for (size_t i = 0; i < rig.axes.size(); ++i) {
    const Axis& axis = rig.axes[i];
    const double a = step.axis_rad[i];
    if (a >= axis.min_rad && a <= axis.max_rad) continue;  // (written so that NaN is refused)
    return InvalidArgument("axis {} to {} deg, its limits are {} to {} deg", axis.name,
                           DegFromRad(a), DegFromRad(axis.min_rad), DegFromRad(axis.max_rad));
  }
  if (step.settle_s >= 0 && step.settle_s <= kMaxSettle_s) return OkStatus();
  return InvalidArgument("{} s of settling, permitted is 0 to {} s", step.settle_s, kMaxSettle_s);
}

Status CheckExposure(double exposure_s, const Camera& camera) {
  if (exposure_s >= camera.min_exposure_s && exposure_s <= camera.max_exposure_s) return OkStatus();
  return InvalidArgument("an exposure of {} s, camera {} does {} to {} s", exposure_s, camera.name,
                         camera.min_exposure_s, camera.max_exposure_s);
}

// Named, ascending and in the rig; every exposure within what they do.
Status CheckCameras(const Step& step, const Rig& rig, const std::vector<double>& exposures_s) {
  if (step.cameras.empty()) return InvalidArgument("no cameras");
  int last = -1;
  for (const int camera : step.cameras) {
    if (camera <= last || camera >= static_cast<int>(rig.cameras.size())) {
      return InvalidArgument("camera {} after {}, the rig has {}, and they ascend", camera, last,
                             rig.cameras.size());
    }
    last = camera;
    for (const double exposure_s : exposures_s) {
      MESORIG_RETURN_IF_ERROR(CheckExposure(exposure_s, rig.cameras[camera]));
    }
  }
  return OkStatus();
}

Status CheckRegion(const Region& r, const Camera& camera) {
  if (r.width > 0 && r.height > 0 && r.x + r.width <= camera.width &&
      r.y + r.height <= camera.height && ((r.x | r.y | r.width | r.height) & 1) == 0) {
    return OkStatus();
  }
  return InvalidArgument("a region of {} x {} pixels at ({}, {}), camera {} has {} x {}", r.width,
                         r.height, r.x, r.y, camera.name, camera.width, camera.height);
}

Status CheckSweep(const Step& step, const Rig& rig) {
  const Sweep& sweep = step.sweep;
  for (const double tilt : {sweep.tilt_from_rad, sweep.tilt_to_rad}) {
    if (std::abs(tilt) <= rig.laser->max_tilt_rad) continue;
    return InvalidArgument("a tilt of {} deg, the laser does {} to both sides", DegFromRad(tilt),
                           DegFromRad(rig.laser->max_tilt_rad));
  }
  if (!(sweep.frame_rate_hz > 0 && sweep.frame_rate_hz <= 1000)) {
    return InvalidArgument("{} frames a second", sweep.frame_rate_hz);
  }
  if (sweep.frames == 0 || sweep.regions.size() != step.cameras.size()) {
    return InvalidArgument("a sweep of {} frames, {} cameras and {} regions", sweep.frames,
                           step.cameras.size(), sweep.regions.size());
  }
  for (size_t k = 0; k < step.cameras.size(); ++k) {
    MESORIG_RETURN_IF_ERROR(CheckRegion(sweep.regions[k], rig.cameras[step.cameras[k]]));
  }
  return OkStatus();
}

Status CheckMount(const Step& step, const Rig& rig) {
  if (!rig.laser) return InvalidArgument("the rig has no laser");
  if (step.sweep.mount >= 0 && step.sweep.mount < static_cast<int>(rig.laser->mounts.size())) {
    return OkStatus();
  }
  return InvalidArgument("mount {}, the laser has {}", step.sweep.mount, rig.laser->mounts.size());
}

Status CheckText(const std::string& text) {
  const bool plain = std::none_of(text.begin(), text.end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20 && c != '\n';
  });
  if (plain && !text.empty() && text.size() <= kMaxPromptBytes) return OkStatus();
  return InvalidArgument("a prompt of {} bytes, permitted is 1 to {} without control characters",
                         text.size(), kMaxPromptBytes);
}

// What only some kinds use.
Status CheckUnused(const Step& step) {
  const bool shot = step.kind == StepKind::kShot, meter = step.kind == StepKind::kMeter;
  if ((step.purpose != Purpose::kData || step.repeat != 0) && !shot) {
    return InvalidArgument("a purpose or a repeat, but no shot");
  }
  if (step.settle_s != 0 && step.kind != StepKind::kMoveAxes) {
    return InvalidArgument("settling, but no move");
  }
  if (step.meter != -1 && !shot && !meter) return InvalidArgument("a meter, but no shot");
  if (!step.ladder_s.empty() && !meter) return InvalidArgument("exposures to choose from");
  if (!step.text.empty() && step.kind != StepKind::kPrompt) return InvalidArgument("a text");
  return OkStatus();
}

}  // namespace

Status StepChecker::CheckShot(const Step& step) const {
  if (step.purpose > Purpose::kFlat) {
    return InvalidArgument("purpose {} is not known", static_cast<int>(step.purpose));
  }
  if (step.meter == -1) return CheckCameras(step, rig_, {step.exposure_s});
  const auto meter = ladder_of_meter_.find(step.meter);
  if (meter == ladder_of_meter_.end()) {
    return InvalidArgument("shot {} has meter {}, which no step before it declares", step.shot,
                           step.meter);
  }
  const std::vector<double>& ladder = meter->second;
  if (step.exposure_s != ladder.back()) {
    return InvalidArgument("shot {} has {} s, the longest of its meter is {} s", step.shot,
                           step.exposure_s, ladder.back());
  }
  return CheckCameras(step, rig_, ladder);
}

Status StepChecker::CheckMeter(const Step& step) {
  const std::vector<double>& ladder = step.ladder_s;
  if (ladder.empty() || ladder.size() > kMaxLadder) {
    return InvalidArgument("a meter of {} exposures, permitted is 1 to {}", ladder.size(),
                           kMaxLadder);
  }
  for (size_t i = 1; i < ladder.size(); ++i) {
    if (!(ladder[i] > ladder[i - 1])) return InvalidArgument("a meter's exposures do not ascend");
  }
  if (step.meter < 0 || !ladder_of_meter_.try_emplace(step.meter, ladder).second) {
    return InvalidArgument("meter {} is there twice or has no number", step.meter);
  }
  return CheckCameras(step, rig_, ladder);
}

Status StepChecker::CheckByKind(const Step& step) {
  switch (step.kind) {
    case StepKind::kMoveAxes:
      return CheckMove(step, rig_);
    case StepKind::kLamp:
      if (step.lamp >= -1 && step.lamp < static_cast<int>(rig_.lamps.size())) return OkStatus();
      return InvalidArgument("lamp {}, the rig has {}", step.lamp, rig_.lamps.size());
    case StepKind::kShot:
      return CheckShot(step);
    case StepKind::kMount:
      return CheckMount(step, rig_);
    case StepKind::kSweep:
      MESORIG_RETURN_IF_ERROR(CheckMount(step, rig_));
      MESORIG_RETURN_IF_ERROR(CheckCameras(step, rig_, {step.exposure_s}));
      return CheckSweep(step, rig_);
    case StepKind::kPrompt:
      return CheckText(step.text);
    case StepKind::kMeter:
      return CheckMeter(step);
  }
  return InvalidArgument("a kind of step {} that is not known", static_cast<int>(step.kind));
}

Status StepChecker::Check(const Step& step) {
  MESORIG_RETURN_IF_ERROR(CheckUnused(step));
  return CheckByKind(step);
}

}  // namespace mesorig
