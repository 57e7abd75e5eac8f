#include <algorithm>
#include <cmath>
#include <deque>

#include "daemon/device/camera.h"
#include "daemon/drivers/driver.h"
#include "protocol/base/log.h"
#include "protocol/sim_wire/payloads.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::daemon::sim_camera {
namespace {

using sim_wire::CameraRegister;

constexpr double kExposureTolerance_s = 1e-6;
constexpr size_t kKeptTriggers = 64;

// Of one rig thread. Borrows clock, link and flag.
class SimCamera final : public Camera {
 public:
  SimCamera(RigClock& clock, sim_wire::SimLink& link, const StopFlag& stop,
            const mesorig::Camera& description)
      : clock_(clock), link_(link), stop_(stop), camera_(description), received_(clock) {}
  ~SimCamera() override {
    if (device_) link_.Subscribe(*device_, [](RigTime, std::string) {});
  }
  const std::string& name() const override { return camera_.name; }
  Status Open() override;
  Status Configure(double exposure_s, const Region& region, uint32_t repeat_index) override;
  Status Trigger(uint32_t trigger_id) override;
  StatusOr<CapturedFrame> Await(uint32_t trigger_id, RigTime deadline) override;
  uint64_t dropped_frames() const override { return faults_.dropped(); }
  FrameFaults frame_faults() const override { return faults_; }

 private:
  struct Triggered {
    uint32_t id = 0;
    RigTime at{};
    bool delivered = false;
  };
  Status WriteRegion(const Region& region);
  Status Write(CameraRegister reg, std::string_view register_name, double value);
  StatusOr<double> Access(const sim_wire::CameraAccess& access, const std::string& context);
  Status CheckOpen() const;
  // Why there is no frame of this trigger, with what came instead.
  Status WhyNoFrame(uint32_t trigger_id, RigTime deadline, const FrameFaults& before);
  // nullopt: not the frame of this trigger; counted.
  StatusOr<std::optional<CapturedFrame>> Accept(std::string payload, uint32_t trigger_id);
  // The count that this frame belongs to; null: it is the awaited one.
  uint64_t FrameFaults::*Judge(const sim_wire::CameraFrame& frame, uint32_t trigger_id) const;
  // Unavailable: the camera is not set as it was told.
  Status CheckSettings(const sim_wire::CameraFrame& frame) const;
  void Drop(uint64_t FrameFaults::*count, std::string_view what);

  RigClock& clock_;
  sim_wire::SimLink& link_;
  const StopFlag& stop_;
  const mesorig::Camera camera_;
  std::optional<Region> region_;  // what frames hold; nothing: not known since Open
  double exposure_s_ = 0;
  std::optional<uint16_t> device_;
  RigTime clock_offset_{};  // the rig's clock less the camera's, taken at Open
  RigQueue<std::string> received_;
  std::deque<Triggered> triggers_;  // the last ones, since Open
  uint64_t last_frame_id_ = 0;      // delivered, since Open
  FrameFaults faults_;
};

struct FaultName {
  uint64_t FrameFaults::*count;
  std::string_view text;
};
constexpr FaultName kFaultNames[] = {
    {&FrameFaults::late, "late"},
    {&FrameFaults::duplicate, "duplicate"},
    {&FrameFaults::torn, "torn"},
    {&FrameFaults::damaged, "damaged"},
    {&FrameFaults::stale, "stale"},
    {&FrameFaults::wrong_id, "of a trigger that was not given"},
    {&FrameFaults::mistimed, "mistimed"},
};

Status SimCamera::CheckOpen() const {
  return device_ ? OkStatus() : FailedPrecondition("camera {}: not open", camera_.name);
}

Status SimCamera::Open() {
  const std::string context = fmt::format("camera {}", camera_.name);
  const auto device = link_.FindDevice(sim_wire::CameraDevice(camera_.serial));
  if (!device.ok()) return Annotate(device.status(), context);
  if (device_ != *device) {
    device_ = *device;
    link_.Subscribe(*device_, [this](RigTime, std::string payload) {
      received_.PushInsideChange(std::move(payload));
    });
  }
  region_.reset();
  triggers_.clear();
  last_frame_id_ = 0;
  received_.Clear();
  MESORIG_ASSIGN_OR_RETURN(const double device_s, Access({CameraRegister::kDeviceTime_s, false, 0},
                                                         context + ": reading its clock"));
  if (!(std::abs(device_s) <= 1e9)) {
    return Unavailable("{}: its clock says {} s", context, device_s);
  }
  clock_offset_ = clock_.Now() - RigTime(std::llround(device_s * 1e9));
  return OkStatus();
}

Status SimCamera::Configure(double exposure_s, const Region& region, uint32_t repeat_index) {
  MESORIG_RETURN_IF_ERROR(CheckOpen());
  if (!(exposure_s >= camera_.min_exposure_s && exposure_s <= camera_.max_exposure_s)) {
    return InvalidArgument("camera {}: exposure {} s is not in [{}, {}] s", camera_.name,
                           exposure_s, camera_.min_exposure_s, camera_.max_exposure_s);
  }
  MESORIG_RETURN_IF_ERROR(Write(CameraRegister::kExposureS, "exposure", exposure_s));
  exposure_s_ = exposure_s;
  if (region_ != region) MESORIG_RETURN_IF_ERROR(WriteRegion(region));
  return Write(CameraRegister::kRepeatIndex, "repeat index", repeat_index);
}

// By way of the sensor's corner: the region fits the sensor after every write.
Status SimCamera::WriteRegion(const Region& region) {
  if (region.x < 0 || region.y < 0 || region.width <= 0 || region.height <= 0 ||
      region.x + region.width > camera_.width || region.y + region.height > camera_.height) {
    return InvalidArgument("camera {}: region {} x {} at ({}, {}) is not in its {} x {} pixels",
                           camera_.name, region.width, region.height, region.x, region.y,
                           camera_.width, camera_.height);
  }
  MESORIG_RETURN_IF_ERROR(Write(CameraRegister::kRegionX, "region x", 0));
  MESORIG_RETURN_IF_ERROR(Write(CameraRegister::kRegionY, "region y", 0));
  MESORIG_RETURN_IF_ERROR(Write(CameraRegister::kRegionWidth, "region width", region.width));
  MESORIG_RETURN_IF_ERROR(Write(CameraRegister::kRegionHeight, "region height", region.height));
  MESORIG_RETURN_IF_ERROR(Write(CameraRegister::kRegionX, "region x", region.x));
  MESORIG_RETURN_IF_ERROR(Write(CameraRegister::kRegionY, "region y", region.y));
  region_ = region;
  return OkStatus();
}

StatusOr<double> SimCamera::Access(const sim_wire::CameraAccess& access,
                                   const std::string& context) {
  const auto answer = link_.Query(*device_, sim_wire::Pack(access));
  // What it refuses although we asked for what it can do, it may take after it was opened again.
  if (!answer.ok()) return Unavailable("{}: {}", context, Message(answer.status()));
  const auto value = sim_wire::UnpackRegisterValue(*answer);
  if (!value.ok()) return Unavailable("{}: {}", context, Message(value.status()));
  return *value;
}

Status SimCamera::Write(CameraRegister reg, std::string_view register_name, double value) {
  const std::string context = fmt::format("camera {}: {} {}", camera_.name, register_name, value);
  MESORIG_ASSIGN_OR_RETURN(const double taken, Access({reg, true, value}, context));
  // The camera may round to its own steps, but not to something else.
  if (!(std::abs(taken - value) <= 1e-3 * std::abs(value) + 1e-9)) {
    return Unavailable("{}: the camera took {}", context, taken);
  }
  return OkStatus();
}

Status SimCamera::Trigger(uint32_t trigger_id) {
  MESORIG_RETURN_IF_ERROR(CheckOpen());
  triggers_.push_back({trigger_id, clock_.Now(), false});
  if (triggers_.size() > kKeptTriggers) triggers_.pop_front();
  return Annotate(link_.Post(*device_, sim_wire::Pack(sim_wire::CameraTrigger{trigger_id})),
                  fmt::format("camera {}: trigger {}", camera_.name, trigger_id));
}

StatusOr<CapturedFrame> SimCamera::Await(uint32_t trigger_id, RigTime deadline) {
  MESORIG_RETURN_IF_ERROR(CheckOpen());
  const FrameFaults before = faults_;
  for (;;) {
    const Status waited = stop_.Wait(deadline, [&] { return !received_.EmptyInsideChange(); });
    if (absl::IsCancelled(waited)) return waited;
    if (!waited.ok()) return WhyNoFrame(trigger_id, deadline, before);
    auto payload = received_.Pop(clock_.Now());
    if (!payload) continue;
    MESORIG_ASSIGN_OR_RETURN(auto frame, Accept(std::move(*payload), trigger_id));
    if (frame) return std::move(*frame);
  }
}

Status SimCamera::WhyNoFrame(uint32_t trigger_id, RigTime deadline, const FrameFaults& before) {
  MESORIG_RETURN_IF_ERROR(link_.health());
  ++faults_.lost;
  std::string instead;
  for (const auto& [count, text] : kFaultNames) {
    const uint64_t came = faults_.*count - before.*count;
    if (came > 0) instead += fmt::format("{}{} {}", instead.empty() ? "" : ", ", came, text);
  }
  const std::string context =
      fmt::format("camera {}: no frame of trigger {} until {:.3f} s{}", camera_.name, trigger_id,
                  Seconds(deadline), instead.empty() ? "" : fmt::format(" (instead: {})", instead));
  const auto there = Access({CameraRegister::kDeviceTime_s, false, 0}, context);
  return there.ok() ? DeadlineExceeded("{}", context) : there.status();
}

void SimCamera::Drop(uint64_t FrameFaults::*count, std::string_view what) {
  ++(faults_.*count);
  Log("drivers").warn("camera {}: dropped {}", camera_.name, what);
}

uint64_t FrameFaults::*SimCamera::Judge(const sim_wire::CameraFrame& frame,
                                        uint32_t trigger_id) const {
  const auto trigger = std::find_if(triggers_.begin(), triggers_.end(), [&](const Triggered& each) {
    return each.id == frame.trigger_id;
  });
  if (trigger == triggers_.end()) return &FrameFaults::wrong_id;
  if (trigger->delivered) return &FrameFaults::duplicate;
  if (trigger->id != trigger_id) return &FrameFaults::late;
  if (frame.frame_id <= last_frame_id_) return &FrameFaults::stale;
  const double off_s =
      Seconds(frame.exposure_start) + Seconds(clock_offset_) - Seconds(trigger->at);
  return std::abs(off_s) <= camera_.trigger_latency_s ? nullptr : &FrameFaults::mistimed;
}

Status SimCamera::CheckSettings(const sim_wire::CameraFrame& frame) const {
  const Region region = region_.value_or(camera_.full_region());
  const size_t bytes = static_cast<size_t>(region.width) * static_cast<size_t>(region.height) *
                       static_cast<size_t>(camera_.bytes_per_pixel());
  if (frame.width != region.width || frame.height != region.height || frame.bits != camera_.bits ||
      frame.pixels.size() != bytes) {
    return Unavailable(
        "camera {}: frame of {} x {} pixels, {} bits, {} bytes; asked for were {} x {}, "
        "{} bits, {} bytes",
        camera_.name, frame.width, frame.height, frame.bits, frame.pixels.size(), region.width,
        region.height, camera_.bits, bytes);
  }
  const double exposed_s = Seconds(frame.exposure_end) - Seconds(frame.exposure_start);
  if (region_ && std::abs(exposed_s - exposure_s_) > kExposureTolerance_s + 1e-3 * exposure_s_) {
    return Unavailable("camera {}: frame exposed for {:.6f} s, asked for were {:.6f} s",
                       camera_.name, exposed_s, exposure_s_);
  }
  return OkStatus();
}

StatusOr<std::optional<CapturedFrame>> SimCamera::Accept(std::string payload, uint32_t trigger_id) {
  auto frame = sim_wire::UnpackCameraFrame(payload);
  if (!frame.ok()) {
    Drop(absl::IsDataLoss(frame.status()) ? &FrameFaults::torn : &FrameFaults::damaged,
         Message(frame.status()));
    return std::nullopt;
  }
  if (uint64_t FrameFaults::*const count = Judge(*frame, trigger_id); count != nullptr) {
    Drop(count, fmt::format("frame {} of trigger {}, exposed at {:.6f} s of its clock (waiting for "
                            "trigger {})",
                            frame->frame_id, frame->trigger_id, Seconds(frame->exposure_start),
                            trigger_id));
    return std::nullopt;
  }
  MESORIG_RETURN_IF_ERROR(CheckSettings(*frame));
  last_frame_id_ = frame->frame_id;
  for (Triggered& trigger : triggers_) trigger.delivered |= trigger.id == trigger_id;
  CapturedFrame captured{frame->trigger_id,
                         frame->frame_id,
                         frame->exposure_start + clock_offset_,
                         frame->exposure_end + clock_offset_,
                         frame->width,
                         frame->height,
                         frame->bits,
                         std::make_shared<const std::string>(std::move(frame->pixels))};
  return captured;
}

}  // namespace

Driver Describe() {
  Driver driver;
  driver.make_camera = [](const DriverContext& context,
                          int index) -> StatusOr<std::unique_ptr<Camera>> {
    const mesorig::Camera& camera = context.rig->cameras.at(index);
    if (context.simulator == nullptr) {
      return FailedPrecondition(
          "camera {}: driver sim_camera needs the simulator, and there is none", camera.name);
    }
    return std::make_unique<SimCamera>(*context.clock, *context.simulator, *context.stop, camera);
  };
  return driver;
}

}  // namespace mesorig::daemon::sim_camera
