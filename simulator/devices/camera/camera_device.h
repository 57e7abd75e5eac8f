#pragma once
// One simulated camera as a SimDevice.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "protocol/rig/rig.h"
#include "protocol/sim_wire/payloads.h"
#include "protocol/sim_wire/sim_server.h"
#include "simulator/plant/sensor.h"

namespace mesorig::simulator {

// What the cameras see of the rig. Called by the dispatcher only.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  // State of the rig over an exposure, and what the noise depends on (seed, axes, lamps, laser).
  struct Scene {
    std::vector<double> axis_rad;    // at mid-exposure, one per Rig::axes
    std::vector<double> lamp_level;  // mean over the exposure, one per Rig::lamps
    int laser_mount = 0;             // index into Laser::mounts
    double laser_level = 0;          // mean over the exposure, 0..1
    double laser_tilt_rad = 0;       // of the emitter, at mid-exposure
    Region region;                   // filled in by the camera: what it reads
    plant::NoiseKey key;  // camera, exposure, gain and repeat are filled in by the camera
  };
  virtual Scene Observe(RigTime from, RigTime to) = 0;
  // Expected electrons per pixel of scene.region, row by row.
  virtual StatusOr<std::vector<float>> ExpectedElectrons(int camera, const Scene& scene,
                                                         double exposure_s) = 0;
};

// By the back-channel: silent [N], torn [N], stale [N], wrong_id [N], clock SECONDS. Unplugged it
// is without supply: settings, frame count and clock begin anew, a silent one speaks again.
class CameraDevice final : public sim_wire::SimDevice {
 public:
  // `index` into Rig::cameras; rig and source are borrowed.
  CameraDevice(const Rig& rig, int index, ImageSource& source);

  std::string name() const override { return sim_wire::CameraDevice(camera_.serial); }
  // A trigger while a frame is being exposed or read out is ignored, as real cameras do.
  void Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) override;
  StatusOr<std::string> Query(RigTime now, std::string_view payload,
                              sim_wire::Outbox& out) override;
  RigTime NextEvent() const override;
  void RunEvent(RigTime now, sim_wire::Outbox& out) override;
  Status Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) override;
  void Plug(RigTime now, bool plugged, sim_wire::Outbox& out) override;

 private:
  // What is wrong with the next so many frames.
  struct Faults {
    uint32_t silent = 0, torn = 0, stale = 0, wrong_id = 0;
  };
  struct Exposure {
    uint32_t trigger_id = 0;
    RigTime start{}, end{}, delivery{};
    std::optional<ImageSource::Scene> scene;  // observed when the exposure ends
  };
  StatusOr<std::string> AccessRegion(const sim_wire::CameraAccess& access);
  void Deliver(sim_wire::Outbox& out);
  void Send(sim_wire::CameraFrame frame, sim_wire::Outbox& out);

  const Camera& camera_;
  const int index_;
  ImageSource& source_;
  double exposure_s_ = 0, gain_ = 1;
  Region region_;  // of the next frames
  uint32_t repeat_index_ = 0;
  uint64_t frames_ = 0;
  RigTime clock_offset_{};  // its own clock less the rig's
  std::optional<Exposure> exposure_;
  Faults faults_;
  std::optional<sim_wire::CameraFrame> last_;  // sent
};

}  // namespace mesorig::simulator
