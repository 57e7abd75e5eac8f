#include "simulator/devices/camera/camera_device.h"

#include <cmath>

#include "protocol/base/log.h"
#include "simulator/devices/faults/fault_table.h"

namespace mesorig::simulator {

using sim_wire::CameraRegister;

namespace {

constexpr uint32_t kAll = 0xFFFFFFFF;
constexpr uint32_t kForeignTriggers = 1'000'000;  // far from any that a run gives

// Whether this frame is one of them.
bool Take(uint32_t& count) {
  if (count == 0) return false;
  if (count != kAll) --count;
  return true;
}

}  // namespace

CameraDevice::CameraDevice(const Rig& rig, int index, ImageSource& source)
    : camera_(rig.cameras[index]),
      index_(index),
      source_(source),
      exposure_s_(camera_.min_exposure_s),
      region_{0, 0, camera_.width, camera_.height} {}

void CameraDevice::Command(RigTime now, std::string_view payload, sim_wire::Outbox&) {
  const auto trigger = sim_wire::UnpackCameraTrigger(payload);
  if (!trigger.ok() || exposure_) {
    spdlog::warn("camera {}: trigger ignored ({})", camera_.name,
                 trigger.ok() ? "a frame is being taken" : Message(trigger.status()));
    return;
  }
  const RigTime end = now + FromSeconds(exposure_s_);
  // Rows that are not read cost no time.
  const double readout_s = camera_.readout_s * region_.height / camera_.height;
  exposure_ = Exposure{trigger->trigger_id, now, end, end + FromSeconds(readout_s), {}};
}

StatusOr<std::string> CameraDevice::Query(RigTime now, std::string_view payload,
                                          sim_wire::Outbox&) {
  MESORIG_ASSIGN_OR_RETURN(const auto access, sim_wire::UnpackCameraAccess(payload));
  const double value = access.value;
  if (access.write && exposure_) {
    return FailedPrecondition("camera {}: busy with a frame", camera_.name);
  }
  switch (access.reg) {
    case CameraRegister::kExposureS:
      if (access.write && !(value >= camera_.min_exposure_s && value <= camera_.max_exposure_s)) {
        return InvalidArgument("camera {}: exposure {} s, permitted is {} to {} s", camera_.name,
                               value, camera_.min_exposure_s, camera_.max_exposure_s);
      }
      if (access.write) exposure_s_ = value;
      return sim_wire::PackRegisterValue(exposure_s_);
    case CameraRegister::kGain:
      if (access.write && !(value > 0 && value <= 64)) {
        return InvalidArgument("camera {}: gain {}, permitted is above 0, to 64", camera_.name,
                               value);
      }
      if (access.write) gain_ = value;
      return sim_wire::PackRegisterValue(gain_);
    case CameraRegister::kRepeatIndex:
      if (access.write && !(value >= 0 && value < 4294967296.0)) {
        return InvalidArgument("camera {}: repeat index {}, permitted is 0 to 2^32 - 1",
                               camera_.name, value);
      }
      if (access.write) repeat_index_ = static_cast<uint32_t>(value);
      return sim_wire::PackRegisterValue(repeat_index_);
    case CameraRegister::kRegionX:
    case CameraRegister::kRegionY:
    case CameraRegister::kRegionWidth:
    case CameraRegister::kRegionHeight:
      return AccessRegion(access);
    case CameraRegister::kDeviceTime_s:
      if (access.write) return InvalidArgument("camera {}: its clock is not set", camera_.name);
      return sim_wire::PackRegisterValue(Seconds(now + clock_offset_));
  }
  return InvalidArgument("camera {}: no such register", camera_.name);
}

StatusOr<std::string> CameraDevice::AccessRegion(const sim_wire::CameraAccess& access) {
  const bool along_x =
      access.reg == CameraRegister::kRegionX || access.reg == CameraRegister::kRegionWidth;
  const bool is_size =
      access.reg == CameraRegister::kRegionWidth || access.reg == CameraRegister::kRegionHeight;
  int& origin = along_x ? region_.x : region_.y;
  int& size = along_x ? region_.width : region_.height;
  if (access.write) {
    const int sensor = along_x ? camera_.width : camera_.height;
    const int low = is_size ? 2 : 0, high = sensor - (is_size ? origin : size);
    // Even, so that the Bayer pattern stays; written so that NaN is refused.
    if (!(access.value >= low && access.value <= high && std::fmod(access.value, 2) == 0)) {
      return InvalidArgument(
          "camera {}: region's {} {}, permitted is even, {} to {} (its {} is {})", camera_.name,
          is_size ? (along_x ? "width" : "height") : (along_x ? "x" : "y"), access.value, low, high,
          is_size ? "origin" : "size", is_size ? origin : size);
    }
    (is_size ? size : origin) = static_cast<int>(access.value);
  }
  return sim_wire::PackRegisterValue(is_size ? size : origin);
}

RigTime CameraDevice::NextEvent() const {
  if (!exposure_) return kNever;
  return exposure_->scene ? exposure_->delivery : exposure_->end;
}

void CameraDevice::RunEvent(RigTime now, sim_wire::Outbox& out) {
  if (!exposure_->scene) exposure_->scene = source_.Observe(exposure_->start, exposure_->end);
  if (now >= exposure_->delivery) Deliver(out);
}

void CameraDevice::Deliver(sim_wire::Outbox& out) {
  Exposure exposure = std::move(*exposure_);
  exposure_.reset();
  exposure.scene->region = region_;  // registers are locked while a frame is taken
  plant::NoiseKey key = exposure.scene->key;
  key.camera_serial = camera_.serial;
  key.exposure_us = static_cast<uint32_t>(std::lround(exposure_s_ * 1e6));
  key.gain = gain_;
  key.repeat_index = repeat_index_;
  const auto electrons = source_.ExpectedElectrons(index_, *exposure.scene, exposure_s_);
  const auto pixels = electrons.ok() ? plant::ReadOut(camera_, region_, *electrons, key)
                                     : StatusOr<std::string>(electrons.status());
  if (!pixels.ok()) {  // no frame: the daemon's deadline names the camera
    spdlog::error("camera {}: {}", camera_.name, Message(pixels.status()));
    return;
  }
  sim_wire::CameraFrame frame;
  frame.trigger_id = exposure.trigger_id;
  frame.frame_id = ++frames_;
  frame.exposure_start = exposure.start + clock_offset_;
  frame.exposure_end = exposure.end + clock_offset_;
  frame.width = static_cast<uint16_t>(region_.width);
  frame.height = static_cast<uint16_t>(region_.height);
  frame.bits = static_cast<uint8_t>(camera_.bits);
  frame.pixels = *pixels;
  Send(std::move(frame), out);
}

void CameraDevice::Send(sim_wire::CameraFrame frame, sim_wire::Outbox& out) {
  if (Take(faults_.silent)) return;
  if (last_ && Take(faults_.stale)) {  // its times and count are the old ones'
    last_->trigger_id = frame.trigger_id;
    out.Send(sim_wire::Pack(*last_));
    return;
  }
  if (Take(faults_.wrong_id)) frame.trigger_id += kForeignTriggers;
  if (Take(faults_.torn)) {
    frame.pixels.resize(frame.pixels.size() / frame.height * (frame.height / 2));
    out.Send(sim_wire::Pack(frame));
    return;
  }
  out.Send(sim_wire::Pack(frame));
  last_ = std::move(frame);
}

Status CameraDevice::Inject(RigTime, std::string_view text, sim_wire::Outbox&) {
  constexpr double kLongest_s = 1e6;
  const auto words = FaultWords(text);
  const std::string_view fault = words.empty() ? std::string_view() : words[0];
  if (fault == "clock" && words.size() == 2) {
    double seconds = 0;
    MESORIG_RETURN_IF_ERROR(FaultReal(words, 1, -kLongest_s, kLongest_s, seconds));
    clock_offset_ += RigTime(static_cast<int64_t>(std::llround(seconds * 1e9)));
    return OkStatus();
  }
  uint32_t* const count = fault == "silent"     ? &faults_.silent
                          : fault == "torn"     ? &faults_.torn
                          : fault == "stale"    ? &faults_.stale
                          : fault == "wrong_id" ? &faults_.wrong_id
                                                : nullptr;
  if (count == nullptr || words.size() > 2) {
    return InvalidArgument(
        "camera {}: \"{}\" is not one of: silent [N], torn [N], stale [N], wrong_id [N], clock "
        "SECONDS",
        camera_.name, text);
  }
  return Annotate(FaultNumber(words, 1, 0, kAll, fault == "silent" ? kAll : 1u, *count),
                  fmt::format("camera {}", camera_.name));
}

void CameraDevice::Plug(RigTime now, bool plugged, sim_wire::Outbox&) {
  exposure_.reset();
  if (!plugged) return;
  exposure_s_ = camera_.min_exposure_s;
  gain_ = 1;
  region_ = camera_.full_region();
  repeat_index_ = 0;
  frames_ = 0;
  clock_offset_ = -now;
  faults_ = {};
  last_.reset();
}

}  // namespace mesorig::simulator
