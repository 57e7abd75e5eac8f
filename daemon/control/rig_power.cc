#include "daemon/control/rig_power.h"

#include <functional>
#include <vector>

namespace mesorig::daemon {
namespace {

constexpr double kHomingMargin_s = 30;
constexpr int kSafeAttempts = 3;

}  // namespace

Status RigPower::Up(HomeWhich homing) {
  const Status permit = context_.safety.MayEnergise();
  context_.board.SetChain(context_.chain.levels());
  MESORIG_RETURN_IF_ERROR(permit);
  MESORIG_RETURN_IF_ERROR(context_.devices.lamps->Open());
  MESORIG_RETURN_IF_ERROR(context_.devices.lamps->AllOff());
  MESORIG_RETURN_IF_ERROR(cameras_.Open());
  // A plan that never sweeps needs no laser.
  if (context_.sweeps()) MESORIG_RETURN_IF_ERROR(context_.devices.laser->Open());
  return AxesOn(homing);
}

Status RigPower::AxesOn(HomeWhich homing) {
  stance_.Forget();
  for (Axis* axis : context_.devices.axes) MESORIG_RETURN_IF_ERROR(axis->Enable());
  return Home(homing);
}

Status RigPower::Home(HomeWhich which) {
  const auto& axes = context_.devices.axes;
  std::vector<size_t> homing;
  for (size_t i = 0; i < axes.size(); ++i) {
    if (which == HomeWhich::kUnreferenced && axes[i]->Read().referenced) continue;
    MESORIG_RETURN_IF_ERROR(axes[i]->StartHoming());
    homing.push_back(i);
  }
  const RigTime start = context_.clock.Now();
  for (const size_t i : homing) {
    const mesorig::Axis& axis = context_.rig.axes[i];
    // At worst over the whole range and back.
    const double seconds = 2 * (axis.max_rad - axis.min_rad) / axis.homing_velocity_rad_s;
    MESORIG_RETURN_IF_ERROR(axes[i]->AwaitHoming(start + FromSeconds(seconds + kHomingMargin_s)));
  }
  stance_.ReadAxes();
  return OkStatus();
}

Status RigPower::Down() {
  stance_.Forget();
  if (context_.gate != nullptr) MESORIG_RETURN_IF_ERROR(context_.gate->Close());
  if (context_.sweeps()) MESORIG_RETURN_IF_ERROR(context_.devices.laser->Stop());
  MESORIG_RETURN_IF_ERROR(context_.devices.lamps->AllOff());
  for (Axis* axis : context_.devices.axes) MESORIG_RETURN_IF_ERROR(axis->Disable());
  stance_.ReadAxes();
  return stance_.ReadLevels().status();
}

Status RigPower::MakeSafe() {
  Status off;
  const auto insist = [&](std::string_view what, const std::function<Status()>& action) {
    Status status = action();
    for (int attempt = 1; attempt < kSafeAttempts && !status.ok(); ++attempt) {
      context_.on_note(fmt::format("{}: {}", what, Message(status)));
      status = action();
    }
    if (!status.ok()) context_.on_note(fmt::format("{}: {}", what, Message(status)));
    if (off.ok() && !status.ok()) off = Annotate(status, what);
  };
  stance_.Forget();
  cameras_.Chill();
  if (context_.gate != nullptr) context_.gate->Shut();  // the one-shot does the rest
  insist("lamps off", [&] { return context_.devices.lamps->AllOff(); });
  // All of them first: a drive that does not answer must not delay the next one's stop.
  for (Axis* axis : context_.devices.axes) {
    insist("quick stop", [&] { return axis->QuickStop(); });
  }
  for (Axis* axis : context_.devices.axes) {
    insist("torque off", [&] { return axis->Disable(); });
  }
  if (context_.sweeps())
    insist("laser's motor off", [&] { return context_.devices.laser->Stop(); });
  stance_.ReadAxes();
  const Status read = stance_.ReadLevels().status();
  if (!read.ok()) context_.on_note(fmt::format("reading lamps: {}", Message(read)));
  return off;
}

Status RigPower::Park() {
  MESORIG_RETURN_IF_ERROR(context_.safety.MayEnergise());
  MESORIG_RETURN_IF_ERROR(AxesOn(HomeWhich::kUnreferenced));
  Stance home;
  home.axis_rad.assign(context_.devices.axes.size(), 0.0);
  MESORIG_RETURN_IF_ERROR(stance_.Reach(home));
  for (Axis* axis : context_.devices.axes) MESORIG_RETURN_IF_ERROR(axis->Disable());
  stance_.ReadAxes();
  return OkStatus();
}

}  // namespace mesorig::daemon
