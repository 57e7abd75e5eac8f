// Sweeps of the laser and the operator's part in them (docs/laser.md).

#include <cmath>

#include "daemon/control/plan_run.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

constexpr int kSweepAttempts = 3;
constexpr double kRunUpMargin_s = 5;  // beyond what the sweep's way before its first frame takes

}  // namespace

// Before hands come near: laser, lamps and torque off. What follows is the rig's own proof that the
// hands are out again.
Status PlanRun::Mount(int mount) {
  if (!LaserReady()) return FailedPrecondition("plan {}: the rig has no laser unit", plan_.name);
  MESORIG_RETURN_IF_ERROR(context_.gate->Close());
  MESORIG_RETURN_IF_ERROR(context_.devices.laser->Stop());
  MESORIG_RETURN_IF_ERROR(SwitchLamp(-1));
  for (Axis* axis : context_.devices.axes) MESORIG_RETURN_IF_ERROR(axis->Disable());
  ReadAxes();
  MESORIG_RETURN_IF_ERROR(AskForMount(mount));
  MESORIG_RETURN_IF_ERROR(context_.chain.Check());
  context_.board.SetChain(context_.chain.levels());
  for (Axis* axis : context_.devices.axes) MESORIG_RETURN_IF_ERROR(axis->Enable());
  MESORIG_RETURN_IF_ERROR(HomeAxes());  // those that lost their reference
  MESORIG_RETURN_IF_ERROR(context_.devices.laser->Open());
  MESORIG_RETURN_IF_ERROR(context_.devices.laser->MarkZero());
  mount_ = mount;
  return OkStatus();
}

Status PlanRun::AskForMount(int mount) {
  const std::string& name = context_.rig.laser->mounts[mount].name;
  context_.chain.Disarm();  // the door is meant to open
  context_.activity.Suspend();
  const Status asked = context_.desk.Ask(
      fmt::format("Mount the laser at \"{}\" and line its stripe up with the turntable's centre. "
                  "Then close the door and press reset.",
                  name),
      name, [&] { context_.on_wait(true); });
  context_.activity.Continue();
  context_.chain.Arm();
  context_.on_wait(false);
  return asked;
}

Status PlanRun::RunSweep(const Step& step) {
  if (!LaserReady()) return FailedPrecondition("plan {}: the rig has no laser unit", plan_.name);
  if (step.sweep.mount != mount_) {
    return FailedPrecondition("plan {}: sweep {} is of mount {}, the laser is at {}", plan_.name,
                              step.sweep.index, step.sweep.mount, mount_);
  }
  MESORIG_RETURN_IF_ERROR(ConfigureCameras(step));
  Owed owed(step.sweep.frames, step.cameras);
  Status missing;
  for (int attempt = 0; attempt < kSweepAttempts; ++attempt) {
    MESORIG_RETURN_IF_ERROR(SweepOnce(step, owed, missing));
    bool complete = true;
    for (const auto& cameras : owed) complete = complete && cameras.empty();
    if (complete) {
      progress_.shots_done += step.sweep.frames;
      context_.on_progress(progress_);
      return OkStatus();
    }
    context_.on_note(
        fmt::format("sweep {}, attempt {}: {}", step.sweep.index, attempt + 1, Message(missing)));
  }
  return Unavailable("sweep {}: frames are missing after {} sweeps: {}", step.sweep.index,
                     kSweepAttempts, Message(missing));
}

// One way of the emitter. Frames that an earlier way left owing are taken on this one, where the
// sheet stands nearly as it did: each frame's own stripe tells where.
Status PlanRun::SweepOnce(const Step& step, Owed& owed, Status& missing) {
  const Sweep& sweep = step.sweep;
  LineLaser& laser = *context_.devices.laser;
  axis_rad_ = ReadAxes();
  MESORIG_ASSIGN_OR_RETURN(lamp_level_, ReadLevels());
  const double steps = std::max(1.0, sweep.frames - 1.0);
  const double wanted = (sweep.tilt_to_rad - sweep.tilt_from_rad) / steps * sweep.frame_rate_hz;
  MESORIG_RETURN_IF_ERROR(laser.Prepare(sweep.tilt_from_rad, wanted));
  Status status = ShootSweepFrames(step, wanted, owed, missing);
  // Also after an error: the laser goes off before anything else happens.
  const Status halted = laser.Stop();
  const Status closed = context_.gate->Close();
  if (status.ok()) status = halted;
  return status.ok() ? closed : status;
}

Status PlanRun::ShootSweepFrames(const Step& step, double rate_rad_s, Owed& owed, Status& missing) {
  const Sweep& sweep = step.sweep;
  LineLaser& laser = *context_.devices.laser;
  MESORIG_ASSIGN_OR_RETURN(const double rate, laser.StartSweep(rate_rad_s));
  // The motor's speeds are whole steps: the frames keep their places and come a little slower.
  const double steps = std::max(1.0, sweep.frames - 1.0);
  const double period_s = (sweep.tilt_to_rad - sweep.tilt_from_rad) / steps / rate;
  MESORIG_RETURN_IF_ERROR(
      laser.AwaitTilt(sweep.tilt_from_rad, context_.clock.Now() + FromSeconds(kRunUpMargin_s)));
  MESORIG_RETURN_IF_ERROR(context_.gate->Open());
  const RigTime start = context_.clock.Now();
  for (uint32_t i = 0; i < sweep.frames; ++i) {
    const Status waited =
        context_.devices.stop->Wait(start + FromSeconds(i * period_s), [] { return false; });
    if (absl::IsCancelled(waited)) return waited;
    context_.gate->Progress();
    if (owed[i].empty()) continue;
    MESORIG_RETURN_IF_ERROR(
        ShootSweepFrame(step, i, start + FromSeconds((i + 1) * period_s), owed[i], missing));
  }
  return OkStatus();
}

// `cameras` are left with those whose frame has not come until the next frame's time.
Status PlanRun::ShootSweepFrame(const Step& step, uint32_t index, RigTime deadline,
                                std::vector<int>& cameras, Status& missing) {
  MESORIG_ASSIGN_OR_RETURN(const bool shines, context_.gate->Shines());
  if (!shines) {
    MESORIG_RETURN_IF_ERROR(context_.chain.Check());
    return Unavailable("sweep {}: the laser went off at frame {}", step.sweep.index, index);
  }
  MESORIG_RETURN_IF_ERROR(TriggerAll(cameras));
  MESORIG_ASSIGN_OR_RETURN(const LaserReading reading, context_.devices.laser->Read());
  return CollectFrames(deadline, cameras, missing, [&](int camera, const CapturedFrame& frame) {
    FrameRecord record = MakeRecord(step, camera, frame);
    record.shot = step.shot + index;
    record.laser = LaserRecord{step.sweep.index, index, step.sweep.mount, reading.tilt_rad, shines};
    return record;
  });
}

}  // namespace mesorig::daemon
