#include <cmath>

#include "daemon/device/camera.h"
#include "daemon/drivers/driver.h"
#include "protocol/base/log.h"
#include "protocol/sim_wire/payloads.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::daemon::sim_camera {
namespace {

using sim_wire::CameraRegister;

// Of one rig thread. Borrows clock, link and flag.
class SimCamera final : public Camera {
 public:
  SimCamera(RigClock& clock, sim_wire::SimLink& link, const StopFlag& stop,
            const mesorig::Camera& description)
      : clock_(clock),
        link_(link),
        stop_(stop),
        camera_(description),
        region_(description.full_region()),
        received_(clock) {}
  ~SimCamera() override {
    if (device_) link_.Subscribe(*device_, [](RigTime, std::string) {});
  }
  const std::string& name() const override { return camera_.name; }
  Status Open() override;
  Status Configure(double exposure_s, const Region& region, uint32_t repeat_index) override;
  Status Trigger(uint32_t trigger_id) override;
  StatusOr<CapturedFrame> Await(uint32_t trigger_id, RigTime deadline) override;
  uint64_t dropped_frames() const override { return dropped_; }

 private:
  Status WriteRegion(const Region& region);
  Status Write(CameraRegister reg, std::string_view register_name, double value);
  Status CheckOpen() const;
  // nullopt: not a frame of this trigger; counted.
  StatusOr<std::optional<CapturedFrame>> Accept(std::string payload, uint32_t trigger_id);

  RigClock& clock_;
  sim_wire::SimLink& link_;
  const StopFlag& stop_;
  const mesorig::Camera camera_;
  Region region_;  // what frames hold
  std::optional<uint16_t> device_;
  RigQueue<std::string> received_;
  uint64_t dropped_ = 0;
};

Status SimCamera::CheckOpen() const {
  return device_ ? OkStatus() : FailedPrecondition("camera {}: not open", camera_.name);
}

Status SimCamera::Open() {
  if (device_) return OkStatus();
  const auto device = link_.FindDevice(sim_wire::CameraDevice(camera_.serial));
  if (!device.ok()) return Annotate(device.status(), fmt::format("camera {}", camera_.name));
  device_ = *device;
  link_.Subscribe(*device_, [this](RigTime, std::string payload) {
    received_.PushInsideChange(std::move(payload));
  });
  return OkStatus();
}

Status SimCamera::Configure(double exposure_s, const Region& region, uint32_t repeat_index) {
  MESORIG_RETURN_IF_ERROR(CheckOpen());
  if (!(exposure_s >= camera_.min_exposure_s && exposure_s <= camera_.max_exposure_s)) {
    return InvalidArgument("camera {}: exposure {} s is not in [{}, {}] s", camera_.name,
                           exposure_s, camera_.min_exposure_s, camera_.max_exposure_s);
  }
  MESORIG_RETURN_IF_ERROR(Write(CameraRegister::kExposureS, "exposure", exposure_s));
  if (region != region_) MESORIG_RETURN_IF_ERROR(WriteRegion(region));
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

Status SimCamera::Write(CameraRegister reg, std::string_view register_name, double value) {
  const auto answer = link_.Query(*device_, sim_wire::Pack({reg, true, value}));
  const std::string context = fmt::format("camera {}: {} {}", camera_.name, register_name, value);
  if (!answer.ok()) return Annotate(answer.status(), context);
  const auto taken = sim_wire::UnpackRegisterValue(*answer);
  if (!taken.ok()) return Annotate(taken.status(), context);
  // The camera may round to its own steps, but not to something else.
  if (!(std::abs(*taken - value) <= 1e-3 * std::abs(value) + 1e-9)) {
    return Unavailable("{}: the camera took {}", context, *taken);
  }
  return OkStatus();
}

Status SimCamera::Trigger(uint32_t trigger_id) {
  MESORIG_RETURN_IF_ERROR(CheckOpen());
  return Annotate(link_.Post(*device_, sim_wire::Pack(sim_wire::CameraTrigger{trigger_id})),
                  fmt::format("camera {}: trigger {}", camera_.name, trigger_id));
}

StatusOr<CapturedFrame> SimCamera::Await(uint32_t trigger_id, RigTime deadline) {
  MESORIG_RETURN_IF_ERROR(CheckOpen());
  for (;;) {
    const Status waited = stop_.Wait(deadline, [&] { return !received_.EmptyInsideChange(); });
    if (absl::IsCancelled(waited)) return waited;
    if (!waited.ok()) {
      MESORIG_RETURN_IF_ERROR(link_.health());
      return DeadlineExceeded("camera {}: no frame of trigger {} until {:.3f} s", camera_.name,
                              trigger_id, Seconds(deadline));
    }
    auto payload = received_.Pop(clock_.Now());
    if (!payload) continue;
    MESORIG_ASSIGN_OR_RETURN(auto frame, Accept(std::move(*payload), trigger_id));
    if (frame) return std::move(*frame);
  }
}

StatusOr<std::optional<CapturedFrame>> SimCamera::Accept(std::string payload, uint32_t trigger_id) {
  auto frame = sim_wire::UnpackCameraFrame(payload);
  if (!frame.ok() || frame->trigger_id != trigger_id) {
    ++dropped_;
    spdlog::warn("camera {}: dropped {}", camera_.name,
                 frame.ok() ? fmt::format("a frame of trigger {} (waiting for {})",
                                          frame->trigger_id, trigger_id)
                            : std::string(Message(frame.status())));
    return std::nullopt;
  }
  const size_t bytes = static_cast<size_t>(region_.width) * static_cast<size_t>(region_.height) *
                       static_cast<size_t>(camera_.bytes_per_pixel());
  if (frame->width != region_.width || frame->height != region_.height ||
      frame->bits != camera_.bits || frame->pixels.size() != bytes) {
    return Unavailable(
        "camera {}: frame of {} x {} pixels, {} bits, {} bytes; asked for were {} x {}, "
        "{} bits, {} bytes",
        camera_.name, frame->width, frame->height, frame->bits, frame->pixels.size(), region_.width,
        region_.height, camera_.bits, bytes);
  }
  CapturedFrame captured{
      frame->trigger_id,     frame->frame_id,
      frame->exposure_start, frame->exposure_end,
      frame->width,          frame->height,
      frame->bits,           std::make_shared<const std::string>(std::move(frame->pixels))};
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
