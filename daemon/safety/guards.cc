#include "daemon/safety/guards.h"

namespace mesorig::daemon {

Status AxisGuard::Enable() {
  MESORIG_RETURN_IF_ERROR(safety_.MayAsk());
  safety_.AskTorque(index_, true);  // before: a drive that answers late has torque already
  return axis_.Enable();
}

Status AxisGuard::MayMove() {
  MESORIG_RETURN_IF_ERROR(safety_.MayAsk());
  safety_.Alive();
  return Annotate(safety_.MayMove(), fmt::format("axis {}", name()));
}

Status AxisGuard::StartHoming() {
  MESORIG_RETURN_IF_ERROR(MayMove());
  return axis_.StartHoming();
}

Status AxisGuard::StartMove(double target_rad) {
  MESORIG_RETURN_IF_ERROR(MayMove());
  return axis_.StartMove(target_rad);
}

Status AxisGuard::Disable() {
  const Status off = axis_.Disable();
  safety_.AskTorque(index_, false);
  return off;
}

Status AxisGuard::AwaitHoming(RigTime deadline) {
  safety_.AliveUntil(deadline);
  const Status there = axis_.AwaitHoming(deadline);
  safety_.Alive();
  return there;
}

Status AxisGuard::AwaitMove(RigTime deadline) {
  safety_.AliveUntil(deadline);
  const Status there = axis_.AwaitMove(deadline);
  safety_.Alive();
  return there;
}

Status LampGuard::SwitchTo(int channel) {
  int lamp = -1;
  for (size_t i = 0; i < rig_.lamps.size() && channel >= 0; ++i) {
    if (rig_.lamps[i].channel == channel) lamp = static_cast<int>(i);
  }
  safety_.Alive();
  if (channel >= 0) {
    MESORIG_RETURN_IF_ERROR(safety_.MayAsk());
    safety_.AskLight(lamp);
  }
  const Status switched = lamps_.SwitchTo(channel);
  return channel < 0 ? WentDark(switched) : switched;
}

StatusOr<std::vector<double>> LampGuard::ReadLevels() {
  safety_.Alive();
  return lamps_.ReadLevels();
}

Status LampGuard::AllOff() {
  return WentDark(lamps_.AllOff());
}

Status LampGuard::WentDark(Status off) {
  if (off.ok()) {
    safety_.AskLight(-1);
  } else {
    safety_.OweDarkness();
  }
  return off;
}

}  // namespace mesorig::daemon
