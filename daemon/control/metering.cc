#include "daemon/control/metering.h"

#include "daemon/control/picture.h"

namespace mesorig::daemon {
namespace {

constexpr int kAttempts = 3;

StatusOr<size_t> BadPixels(const RunContext& context, CameraArray& cameras, const Step& step,
                           double exposure_s) {
  MESORIG_RETURN_IF_ERROR(cameras.Configure(step.cameras, exposure_s, {}, step.repeat));
  MESORIG_RETURN_IF_ERROR(cameras.WarmUp(step.cameras));
  std::vector<int> owing = step.cameras;
  size_t bad = 0;
  Status missing;
  for (int attempt = 0; attempt < kAttempts && !owing.empty(); ++attempt) {
    MESORIG_RETURN_IF_ERROR(cameras.Trigger(owing));
    MESORIG_RETURN_IF_ERROR(cameras.Collect(
        cameras.Deadline(owing), owing, missing, [&](int camera, const CapturedFrame& frame) {
          const PictureFigures figures = MeasurePicture(context.rig.cameras[camera], frame.width,
                                                        frame.height, *frame.pixels, 1);
          bad += figures.saturated + figures.dark;
          return OkStatus();
        }));
  }
  if (owing.empty()) return bad;
  return Unavailable("metering {} at {} s: no frame after {} triggers: {}", step.meter, exposure_s,
                     kAttempts, Message(missing));
}

}  // namespace

double ChooseExposure(const std::vector<double>& ladder_s, const std::vector<size_t>& bad_pixels) {
  size_t best = 0;
  for (size_t i = 1; i < ladder_s.size(); ++i) {
    if (bad_pixels[i] <= bad_pixels[best]) best = i;
  }
  return ladder_s[best];
}

Status Meter(const RunContext& context, CameraArray& cameras, ShotBook& book, const Step& step) {
  if (step.ladder_s.empty()) {
    return InvalidArgument("plan {}: metering {} has no exposures", context.plan.name, step.meter);
  }
  std::vector<size_t> bad_pixels;
  for (const double exposure_s : step.ladder_s) {
    MESORIG_ASSIGN_OR_RETURN(const size_t bad, BadPixels(context, cameras, step, exposure_s));
    bad_pixels.push_back(bad);
  }
  const double chosen = ChooseExposure(step.ladder_s, bad_pixels);
  return book.Record(JournalKind::kExposure, step.meter, chosen,
                     fmt::format("metering {}: {} s", step.meter, chosen));
}

}  // namespace mesorig::daemon
