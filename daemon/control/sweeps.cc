#include "daemon/control/sweeps.h"

#include <algorithm>
#include <cmath>

namespace mesorig::daemon {
namespace {

constexpr int kAttempts = 3;
constexpr double kPrepareLimit_s = 120;  // the emitter's whole way, there and back
constexpr double kGateMargin_s = 5;  // what its last frame's readout and a slow bus may take
constexpr double kRunUpMargin_s = 5;  // beyond what the sweep's way before its first frame takes

}  // namespace

Status Sweeps::Take(const Step& step, const Stance& stance) {
  Owed owed;
  for (uint32_t i = 0; i < step.sweep.frames; ++i) owed.push_back(book_.Owed(step, i));
  MESORIG_RETURN_IF_ERROR(
      cameras_.Configure(step.cameras, step.exposure_s, step.sweep.regions, step.repeat));
  MESORIG_RETURN_IF_ERROR(stance_.Begin(stance));
  MESORIG_RETURN_IF_ERROR(cameras_.WarmUp(step.cameras));
  Status missing;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    MESORIG_RETURN_IF_ERROR(Once(step, stance, owed, missing));
    const bool complete =
        std::all_of(owed.begin(), owed.end(), [](const auto& cameras) { return cameras.empty(); });
    if (complete) return OkStatus();
    context_.on_note(
        fmt::format("sweep {}, attempt {}: {}", step.sweep.index, attempt + 1, Message(missing)));
  }
  return Unavailable("sweep {}: frames are missing after {} sweeps: {}", step.sweep.index,
                     kAttempts, Message(missing));
}

// One way of the emitter. Frames that an earlier way left owing are taken on this one, where the
// sheet stands nearly as it did: each frame's own stripe tells where.
Status Sweeps::Once(const Step& step, const Stance& stance, Owed& owed, Status& missing) {
  const Sweep& sweep = step.sweep;
  LineLaser& laser = *context_.devices.laser;
  MESORIG_RETURN_IF_ERROR(stance_.Begin(stance));
  const double steps = std::max(1.0, sweep.frames - 1.0);
  const double wanted = (sweep.tilt_to_rad - sweep.tilt_from_rad) / steps * sweep.frame_rate_hz;
  context_.safety.AliveUntil(context_.clock.Now() + FromSeconds(kPrepareLimit_s));
  MESORIG_RETURN_IF_ERROR(laser.Prepare(sweep.tilt_from_rad, wanted));
  MESORIG_RETURN_IF_ERROR(stance_.Reach(stance));
  MESORIG_ASSIGN_OR_RETURN(auto levels, stance_.ReadLevels());
  MESORIG_RETURN_IF_ERROR(stance_.CheckHolds());
  book_.SetReadBack(stance_.ReadAxes(), std::move(levels));
  Status status = ShootFrames(step, wanted, owed, missing);
  // Also after an error: the laser goes off before anything else happens.
  const Status halted = laser.Stop();
  const Status closed = context_.gate->Close();
  if (status.ok()) status = halted;
  return status.ok() ? closed : status;
}

Status Sweeps::ShootFrames(const Step& step, double rate_rad_s, Owed& owed, Status& missing) {
  const Sweep& sweep = step.sweep;
  LineLaser& laser = *context_.devices.laser;
  MESORIG_ASSIGN_OR_RETURN(const double rate, laser.StartSweep(rate_rad_s));
  // The motor's speeds are whole steps: the frames keep their places and come a little slower.
  const double steps = std::max(1.0, sweep.frames - 1.0);
  const double period_s = (sweep.tilt_to_rad - sweep.tilt_from_rad) / steps / rate;
  MESORIG_RETURN_IF_ERROR(
      laser.AwaitTilt(sweep.tilt_from_rad, context_.clock.Now() + FromSeconds(kRunUpMargin_s)));
  MESORIG_RETURN_IF_ERROR(
      context_.gate->Open(context_.clock.Now() + FromSeconds(sweep.frames * period_s + kGateMargin_s)));
  const RigTime start = context_.clock.Now();
  for (uint32_t i = 0; i < sweep.frames; ++i) {
    const Status waited =
        context_.devices.stop->Wait(start + FromSeconds(i * period_s), [] { return false; });
    if (absl::IsCancelled(waited)) return waited;
    context_.gate->Progress();
    context_.safety.Alive();
    if (owed[i].empty()) continue;
    MESORIG_RETURN_IF_ERROR(
        ShootFrame(step, i, start + FromSeconds((i + 1) * period_s), owed[i], missing));
    if (owed[i].empty()) book_.ShotDone();
  }
  return OkStatus();
}

Status Sweeps::CheckSheet(const Step& step, uint32_t index) {
  MESORIG_ASSIGN_OR_RETURN(const bool shines, context_.gate->Shines());
  if (shines) return stance_.CheckHolds();
  MESORIG_RETURN_IF_ERROR(context_.chain.Check());
  return Unavailable("sweep {}: the laser went off at frame {}", step.sweep.index, index);
}

// `cameras` are left with those whose frame has not come until the next frame's time.
Status Sweeps::ShootFrame(const Step& step, uint32_t index, RigTime deadline,
                          std::vector<int>& cameras, Status& missing) {
  MESORIG_RETURN_IF_ERROR(CheckSheet(step, index));
  MESORIG_RETURN_IF_ERROR(cameras_.Trigger(cameras));
  MESORIG_ASSIGN_OR_RETURN(const LaserReading reading, context_.devices.laser->Read());
  const Status exposed =
      context_.devices.stop->Wait(cameras_.ExposureEnd(cameras), [] { return false; });
  if (absl::IsCancelled(exposed)) return exposed;
  MESORIG_RETURN_IF_ERROR(CheckSheet(step, index));  // it shone and stood through the exposure
  return cameras_.Collect(deadline, cameras, missing, [&](int camera, const CapturedFrame& frame) {
    FrameRecord record =
        book_.MakeRecord(step, step.exposure_s, cameras_.region(camera), frame, camera);
    record.shot = step.shot + index;
    record.laser = LaserRecord{step.sweep.index, index, step.sweep.mount, reading.tilt_rad, true};
    return book_.Append(std::move(record), frame);
  });
}

}  // namespace mesorig::daemon
