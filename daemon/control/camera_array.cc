#include "daemon/control/camera_array.h"

#include <algorithm>

#include "daemon/control/frame_check.h"

namespace mesorig::daemon {
namespace {

constexpr double kFrameMargin_s = 0.5;

}  // namespace

CameraArray::CameraArray(const RunContext& context)
    : context_(context), states_(context.devices.cameras.size()) {}

Status CameraArray::Open() {
  for (size_t i = 0; i < states_.size(); ++i) {
    MESORIG_RETURN_IF_ERROR(context_.devices.cameras[i]->Open());
    states_[i] = {};
    states_[i].dropped = context_.devices.cameras[i]->dropped_frames();
  }
  return OkStatus();
}

void CameraArray::Chill() {
  for (State& state : states_) state.cold = true;
}

Status CameraArray::Configure(const std::vector<int>& cameras, double exposure_s,
                              const std::vector<Region>& regions, uint32_t repeat) {
  for (size_t k = 0; k < cameras.size(); ++k) {
    State& state = states_[cameras[k]];
    const Setting setting{
        exposure_s, regions.empty() ? context_.rig.cameras[cameras[k]].full_region() : regions[k],
        repeat};
    if (state.setting == setting) continue;
    state.setting = {};
    MESORIG_RETURN_IF_ERROR(
        context_.devices.cameras[cameras[k]]->Configure(exposure_s, setting.region, repeat));
    state.setting = setting;
  }
  return OkStatus();
}

bool CameraArray::IsCold(int camera) const {
  const State& state = states_[camera];
  return state.cold || context_.clock.Now() - state.used_at > FromSeconds(kIdle_s);
}

Status CameraArray::WarmUp(const std::vector<int>& cameras) {
  std::vector<int> cold;
  for (const int camera : cameras) {
    if (IsCold(camera)) cold.push_back(camera);
  }
  if (cold.empty()) return OkStatus();
  MESORIG_RETURN_IF_ERROR(Trigger(cold));
  const RigTime deadline = Deadline(cold);
  for (const int camera : cold) {
    const auto frame = context_.devices.cameras[camera]->Await(last_trigger_, deadline);
    if (absl::IsCancelled(frame.status())) return frame.status();
    // That it does not come is what it is for.
    State& state = states_[camera];
    if (frame.ok()) state.last_frame_id = frame->frame_id;
    state.dropped = context_.devices.cameras[camera]->dropped_frames();
  }
  return OkStatus();
}

Status CameraArray::Trigger(const std::vector<int>& cameras) {
  ++last_trigger_;
  triggered_at_ = context_.clock.Now();
  for (const int camera : cameras) {  // nothing waits between these
    MESORIG_RETURN_IF_ERROR(context_.devices.cameras[camera]->Trigger(last_trigger_));
    states_[camera].cold = false;
    states_[camera].used_at = triggered_at_;
  }
  return OkStatus();
}

RigTime CameraArray::ExposureEnd(const std::vector<int>& cameras) const {
  double until_s = 0;
  for (const int camera : cameras) {
    until_s = std::max(until_s, states_[camera].setting.exposure_s +
                                    context_.rig.cameras[camera].trigger_latency_s);
  }
  return triggered_at_ + FromSeconds(until_s);
}

RigTime CameraArray::Deadline(const std::vector<int>& cameras) const {
  double readout_s = 0;
  for (const int camera : cameras) {
    readout_s = std::max(readout_s, context_.rig.cameras[camera].readout_s);
  }
  return ExposureEnd(cameras) + FromSeconds(readout_s + kFrameMargin_s);
}

StatusOr<CapturedFrame> CameraArray::TakeFrame(int camera, RigTime deadline) {
  State& state = states_[camera];
  auto came = context_.devices.cameras[camera]->Await(last_trigger_, deadline);
  if (!came.ok()) {
    if (!absl::IsCancelled(came.status())) context_.board.Count({.late = 0, .lost = 1});
    return came.status();
  }
  CapturedFrame frame = *std::move(came);
  const ExpectedFrame expected{last_trigger_, triggered_at_, deadline, state.last_frame_id,
                               state.setting.region};
  const RigTime now = context_.clock.Now();
  const Status good = CheckFrame(context_.rig.cameras[camera], expected, frame, now);
  state.last_frame_id = std::max(state.last_frame_id, frame.frame_id);
  if (!good.ok()) {
    const bool late = now > deadline;
    context_.board.Count({.late = late ? 1u : 0u, .lost = 0, .refused = late ? 0u : 1u});
  }
  MESORIG_RETURN_IF_ERROR(good);
  return frame;
}

void CameraArray::NoteDropped(int camera) {
  const uint64_t dropped = context_.devices.cameras[camera]->dropped_frames();
  if (dropped == states_[camera].dropped) return;
  context_.on_note(fmt::format("camera {}: {} frames of other triggers dropped, late or duplicated",
                               context_.rig.cameras[camera].name,
                               dropped - states_[camera].dropped));
  context_.board.Count({.late = dropped - states_[camera].dropped});
  states_[camera].dropped = dropped;
}

Status CameraArray::Collect(RigTime deadline, std::vector<int>& cameras, Status& missing,
                            const Take& take) {
  std::vector<int> owing;
  for (const int camera : cameras) {
    const auto frame = TakeFrame(camera, deadline);
    NoteDropped(camera);
    if (absl::IsCancelled(frame.status())) return frame.status();
    if (!frame.ok()) {
      missing = frame.status();
      owing.push_back(camera);
      context_.on_note(std::string(Message(missing)));
      continue;
    }
    MESORIG_RETURN_IF_ERROR(take(camera, *frame));
  }
  cameras = std::move(owing);
  return OkStatus();
}

}  // namespace mesorig::daemon
