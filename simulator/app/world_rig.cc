#include "simulator/app/world_rig.h"

#include <cmath>

namespace mesorig::simulator {

WorldRig::WorldRig(const Rig& rig, const world::World& world, uint64_t seed,
                   world::ImageOptions options)
    : rig_(rig),
      seed_(seed),
      can_(rig, seed, contactor_),
      lamps_(rig, contactor_),
      lines_(rig.lines, contactor_),
      images_(rig, world, options) {
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    cameras_.push_back(std::make_unique<CameraDevice>(rig, static_cast<int>(i), *this));
  }
}

std::vector<sim_wire::SimDevice*> WorldRig::Devices() {
  std::vector<sim_wire::SimDevice*> devices = {&can_, &lamps_, &lines_};
  for (const auto& camera : cameras_) devices.push_back(camera.get());
  return devices;
}

ImageSource::Scene WorldRig::Observe(RigTime from, RigTime to) {
  Scene scene;
  const RigTime middle = from + (to - from) / 2;
  for (size_t i = 0; i < rig_.axes.size(); ++i) {
    // An axis at rest stands on a whole count. One that moves is seen where it is half way through
    // the exposure: motion blur is not simulated.
    const double counts = std::round(can_.node(i).WorldCounts(middle));
    scene.axis_rad.push_back(counts / rig_.axes[i].counts_per_turn * 2 * kPi);
    scene.key.axis_counts.push_back(static_cast<int64_t>(counts));
  }
  scene.lamp_level = lamps_.MeanLevels(from, to);
  scene.key.lamp_levels = lamps_.CommandedLevels();
  scene.key.seed = seed_;
  return scene;
}

StatusOr<std::vector<float>> WorldRig::ExpectedElectrons(int camera, const Scene& scene,
                                                         double exposure_s) {
  return images_.ExpectedElectrons(
      camera,
      {scene.axis_rad,
       scene.lamp_level,
       {scene.laser_mount, scene.laser_level, scene.laser_tilt_rad}},
      exposure_s, scene.region);
}

}  // namespace mesorig::simulator
