#include "daemon/control/plan_run.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

constexpr double kMoveMargin_s = 5;
constexpr double kHomingMargin_s = 30;
constexpr double kFrameMargin_s = 0.5;
constexpr int kShotAttempts = 3;
// Light is steady: this near to full (or to dark), and two readings this near to each other.
constexpr double kSteadyLevel = 0.002, kSteadyChange = 0.001;
constexpr int kPollsPerSettle = 8, kSettleTimes = 4;
// A lamp that lost this much between settling and the shot went off (supply, communication loss).
constexpr double kLostLevel = 0.02;

}  // namespace

Status PlanRun::Run() {
  MESORIG_RETURN_IF_ERROR(Prepare());
  for (const Step& step : plan_.steps) {
    MESORIG_RETURN_IF_ERROR(context_.chain.Check());
    context_.board.SetChain(context_.chain.levels());
    MESORIG_RETURN_IF_ERROR(context_.devices.stop->Check());
    if (plan_.sweeps > 0 && LaserReady()) {
      MESORIG_RETURN_IF_ERROR(context_.devices.laser->KeepAlive());
    }
    MESORIG_RETURN_IF_ERROR(RunStep(step));
  }
  return WindDown();
}

Status PlanRun::Prepare() {
  MESORIG_RETURN_IF_ERROR(context_.chain.Check());
  context_.board.SetChain(context_.chain.levels());
  MESORIG_RETURN_IF_ERROR(context_.devices.lamps->Open());
  MESORIG_RETURN_IF_ERROR(context_.devices.lamps->AllOff());
  for (Camera* camera : context_.devices.cameras) MESORIG_RETURN_IF_ERROR(camera->Open());
  camera_settings_.assign(context_.devices.cameras.size(), {});
  // A plan that never sweeps needs no laser.
  if (plan_.sweeps > 0 && LaserReady()) MESORIG_RETURN_IF_ERROR(context_.devices.laser->Open());
  for (Axis* axis : context_.devices.axes) MESORIG_RETURN_IF_ERROR(axis->Enable());
  return HomeAxes();
}

Status PlanRun::HomeAxes() {
  std::vector<size_t> homing;
  for (size_t i = 0; i < context_.devices.axes.size(); ++i) {
    if (context_.devices.axes[i]->Read().referenced) continue;
    MESORIG_RETURN_IF_ERROR(context_.devices.axes[i]->StartHoming());
    homing.push_back(i);
  }
  const RigTime start = context_.clock.Now();
  for (const size_t i : homing) {
    const mesorig::Axis& axis = context_.rig.axes[i];
    // At worst over the whole range and back.
    const double seconds = 2 * (axis.max_rad - axis.min_rad) / axis.homing_velocity_rad_s;
    const RigTime deadline = start + FromSeconds(seconds + kHomingMargin_s);
    MESORIG_RETURN_IF_ERROR(context_.devices.axes[i]->AwaitHoming(deadline));
  }
  ReadAxes();
  return OkStatus();
}

Status PlanRun::RunStep(const Step& step) {
  switch (step.kind) {
    case StepKind::kMoveAxes:
      return MoveAxes(step);
    case StepKind::kLamp:
      return SwitchLamp(step.lamp);
    case StepKind::kShot:
      return Shoot(step);
    case StepKind::kMount:
      return Mount(step.sweep.mount);
    case StepKind::kSweep:
      return RunSweep(step);
    case StepKind::kPrompt:
    case StepKind::kMeter:
      return Unimplemented("plan {}: prompts and metering", plan_.name);
  }
  return Internal("plan {}: a step of unknown kind {}", plan_.name, static_cast<int>(step.kind));
}

std::vector<double> PlanRun::ReadAxes() {
  std::vector<double> positions;
  for (size_t i = 0; i < context_.devices.axes.size(); ++i) {
    const AxisReading reading = context_.devices.axes[i]->Read();
    context_.board.SetAxis(i, reading);
    positions.push_back(reading.position_rad);
  }
  return positions;
}

Status PlanRun::MoveAxes(const Step& step) {
  const auto& axes = context_.devices.axes;
  std::vector<RigTime> deadlines;
  for (size_t i = 0; i < axes.size(); ++i) {
    const double distance = step.axis_rad[i] - axes[i]->Read().position_rad;
    MESORIG_RETURN_IF_ERROR(axes[i]->StartMove(step.axis_rad[i]));
    deadlines.push_back(context_.clock.Now() +
                        FromSeconds(MoveSeconds(context_.rig.axes[i], distance) + kMoveMargin_s));
  }
  for (size_t i = 0; i < axes.size(); ++i) {
    MESORIG_RETURN_IF_ERROR(axes[i]->AwaitMove(deadlines[i]));
  }
  ReadAxes();
  return OkStatus();
}

StatusOr<std::vector<double>> PlanRun::ReadLevels() {
  MESORIG_ASSIGN_OR_RETURN(auto levels, context_.devices.lamps->ReadLevels());
  if (levels.size() != context_.rig.lamps.size()) {
    return Internal("lamp bank: {} levels of {} lamps", levels.size(), context_.rig.lamps.size());
  }
  context_.board.SetLevels(levels, context_.clock.Now());
  return levels;
}

bool PlanRun::Steady(const std::vector<double>& levels) const {
  if (levels.size() != context_.rig.lamps.size()) return false;  // no reading yet
  for (size_t i = 0; i < levels.size(); ++i) {
    const double wanted = static_cast<int>(i) == lamp_ ? 1 : 0;
    if (!(std::abs(levels[i] - wanted) <= kSteadyLevel)) return false;
  }
  return true;
}

// Measures instead of sleeping: steady light has had the rig's settling time, and two readings in a
// row say that it is there.
Status PlanRun::SwitchLamp(int lamp) {
  const auto& lamps = context_.rig.lamps;
  lamp_ = lamp;
  MESORIG_RETURN_IF_ERROR(context_.devices.lamps->SwitchTo(lamp < 0 ? -1 : lamps[lamp].channel));
  double settle_s = 0;  // lamps that go off count too
  for (const auto& each : lamps) settle_s = std::max(settle_s, each.settle_s);
  const RigTime start = context_.clock.Now();
  std::vector<double> last, levels;
  for (int poll = 1; poll <= kPollsPerSettle * kSettleTimes; ++poll) {
    const RigTime next = start + FromSeconds(settle_s * poll / kPollsPerSettle);
    const Status waited = context_.devices.stop->Wait(next, [] { return false; });
    if (absl::IsCancelled(waited)) return waited;
    last = std::move(levels);
    MESORIG_ASSIGN_OR_RETURN(levels, ReadLevels());
    if (poll < kPollsPerSettle || !Steady(levels) || !Steady(last)) continue;
    double change = 0;
    for (size_t i = 0; i < levels.size(); ++i) {
      change = std::max(change, std::abs(levels[i] - last[i]));
    }
    if (change <= kSteadyChange) return OkStatus();
  }
  std::string read_back;
  for (const double level : levels) read_back += fmt::format(" {:.3f}", level);
  return Unavailable("{}: light not steady after {:.3f} s; levels read back:{}",
                     lamp < 0 ? "all lamps off" : "lamp " + lamps[lamp].name,
                     settle_s * kSettleTimes, read_back);
}

Status PlanRun::ConfigureCameras(const Step& step) {
  for (size_t k = 0; k < step.cameras.size(); ++k) {
    const int camera = step.cameras[k];
    const CameraSetting setting{step.exposure_s, step.kind == StepKind::kSweep
                                                     ? step.sweep.regions[k]
                                                     : context_.rig.cameras[camera].full_region()};
    if (camera_settings_[camera] == setting) continue;
    MESORIG_RETURN_IF_ERROR(
        context_.devices.cameras[camera]->Configure(setting.exposure_s, setting.region, 0));
    camera_settings_[camera] = setting;
  }
  return OkStatus();
}

Status PlanRun::Shoot(const Step& step) {
  MESORIG_RETURN_IF_ERROR(ConfigureCameras(step));
  std::vector<int> pending = step.cameras;
  Status missing;
  for (int attempt = 0; attempt < kShotAttempts; ++attempt) {
    MESORIG_RETURN_IF_ERROR(ShootOnce(step, pending, missing));
    if (pending.empty()) {
      ++progress_.shots_done;
      context_.on_progress(progress_);
      return OkStatus();
    }
    context_.on_note(
        fmt::format("shot {}, attempt {}: {}", step.shot, attempt + 1, Message(missing)));
  }
  return Unavailable("shot {}: no frame after {} triggers: {}", step.shot, kShotAttempts,
                     Message(missing));
}

Status PlanRun::ShootOnce(const Step& step, std::vector<int>& cameras, Status& missing) {
  axis_rad_ = ReadAxes();
  MESORIG_ASSIGN_OR_RETURN(lamp_level_, ReadLevels());
  if (lamp_ >= 0 && lamp_level_[lamp_] < 1 - kLostLevel) {
    return Unavailable("lamp {}: level {:.3f} at shot {}, 1 wanted", context_.rig.lamps[lamp_].name,
                       lamp_level_[lamp_], step.shot);
  }
  MESORIG_RETURN_IF_ERROR(TriggerAll(cameras));
  double readout_s = 0;
  for (const int camera : cameras) {
    readout_s = std::max(readout_s, context_.rig.cameras[camera].readout_s);
  }
  const RigTime deadline =
      context_.clock.Now() + FromSeconds(step.exposure_s + readout_s + kFrameMargin_s);
  return CollectFrames(deadline, cameras, missing, [&](int camera, const CapturedFrame& frame) {
    return MakeRecord(step, camera, frame);
  });
}

// Nothing waits between these: one instant.
Status PlanRun::TriggerAll(const std::vector<int>& cameras) {
  ++last_trigger_;
  for (const int camera : cameras) {
    MESORIG_RETURN_IF_ERROR(context_.devices.cameras[camera]->Trigger(last_trigger_));
  }
  return OkStatus();
}

Status PlanRun::CollectFrames(RigTime deadline, std::vector<int>& cameras, Status& missing,
                              const RecordMaker& make_record) {
  std::vector<int> owing;
  for (const int camera : cameras) {
    auto frame = context_.devices.cameras[camera]->Await(last_trigger_, deadline);
    if (absl::IsDeadlineExceeded(frame.status())) {
      missing = frame.status();
      owing.push_back(camera);
      continue;
    }
    if (!frame.ok()) return frame.status();
    MESORIG_RETURN_IF_ERROR(session_.Append(make_record(camera, *frame), frame->pixels));
    ++progress_.frames;
  }
  cameras = std::move(owing);
  return OkStatus();
}

FrameRecord PlanRun::MakeRecord(const Step& step, int camera, const CapturedFrame& frame) const {
  FrameRecord record;
  record.camera = camera;
  record.shot = step.shot;
  record.trigger_id = frame.trigger_id;
  record.frame_id = frame.frame_id;
  record.exposure_start_ns = frame.exposure_start.count();
  record.exposure_end_ns = frame.exposure_end.count();
  record.exposure_s = step.exposure_s;
  record.axis_rad = axis_rad_;
  record.lamp_level = lamp_level_;
  record.width = frame.width;
  record.height = frame.height;
  record.bits = frame.bits;
  record.region_x = camera_settings_[camera].region.x;
  record.region_y = camera_settings_[camera].region.y;
  return record;
}

Status PlanRun::WindDown() {
  if (context_.gate != nullptr) MESORIG_RETURN_IF_ERROR(context_.gate->Close());
  MESORIG_RETURN_IF_ERROR(context_.devices.lamps->AllOff());
  lamp_ = -1;
  for (Axis* axis : context_.devices.axes) MESORIG_RETURN_IF_ERROR(axis->Disable());
  ReadAxes();
  return ReadLevels().status();
}

void PlanRun::MakeSafe() {
  const auto note = [&](std::string_view what, const Status& status) {
    if (status.ok()) return;
    spdlog::error("{}: {}", what, Message(status));
    context_.on_note(fmt::format("{}: {}", what, Message(status)));
  };
  if (context_.gate != nullptr) context_.gate->Shut();  // the one-shot does the rest
  note("lamps off", context_.devices.lamps->AllOff());
  // All of them first: a drive that does not answer must not delay the next one's stop.
  for (Axis* axis : context_.devices.axes) note("quick stop", axis->QuickStop());
  for (Axis* axis : context_.devices.axes) note("torque off", axis->Disable());
  if (plan_.sweeps > 0 && LaserReady()) note("laser's motor off", context_.devices.laser->Stop());
  ReadAxes();
  note("reading lamps", ReadLevels().status());
}

}  // namespace mesorig::daemon
