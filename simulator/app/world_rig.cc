#include "simulator/app/world_rig.h"

#include <cmath>

namespace mesorig::simulator {

WorldRig::WorldRig(const Rig& rig, const world::World& world, uint64_t seed,
                   world::ImageOptions options, RigLog* log, bool reset_pressed)
    : rig_(rig),
      seed_(seed),
      can_(rig, seed, contactor_),
      lamps_(rig, contactor_),
      laser_(rig.laser ? std::make_unique<LaserUnit>(rig, seed, contactor_) : nullptr),
      brick_(rig.laser ? std::make_unique<NxtBrick>(rig, *laser_) : nullptr),
      lines_(rig.lines, contactor_, laser_.get()),
      images_(rig, world, options) {
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    cameras_.push_back(std::make_unique<CameraDevice>(rig, static_cast<int>(i), *this));
  }
  std::vector<sim_wire::SimDevice*> devices = {&can_, &lamps_};
  if (brick_) devices.push_back(brick_.get());
  devices.push_back(&lines_);
  for (const auto& camera : cameras_) devices.push_back(camera.get());
  devices_ = std::make_unique<FaultyDevices>(devices);
  if (!reset_pressed) {
    contactor_.SetChain(false, {});
    contactor_.SetChain(true, {});
  }
  if (log != nullptr) LogTo(*log);
}

void WorldRig::LogTo(RigLog& log) {
  log.Write({}, "contactor", contactor_.closed() ? "closed" : "open");
  contactor_.OnChange([&log](bool closed, RigTime now) {
    log.Write(now, "contactor", closed ? "closed" : "open");
  });
  for (const Axis& axis : rig_.axes) log.Write({}, "axis " + axis.name, "stands");
  can_.OnMotion([this, &log](size_t axis, bool moves, RigTime now) {
    log.Write(now, "axis " + rig_.axes[axis].name, moves ? "moves" : "stands");
  });
  can_.OnTorque([this, &log](size_t axis, bool on, RigTime now) {
    log.Write(now, "torque " + rig_.axes[axis].name, on ? "on" : "off");
  });
  lamps_.OnPower([this, &log](size_t lamp, bool on, RigTime now) {
    log.Write(now, "lamp " + rig_.lamps[lamp].name, on ? "on" : "off");
  });
  if (!laser_) return;
  log.Write({}, "mount", rig_.laser->mounts[laser_->mount()].name);
  log.Write({}, "laser", "off");
  laser_->OnMount([this, &log](int mount, RigTime now) {
    log.Write(now, "mount", rig_.laser->mounts[mount].name);
  });
  laser_->OnShine(
      [&log](bool shines, RigTime now) { log.Write(now, "laser", shines ? "on" : "off"); });
  brick_->OnMotor([&log](std::string_view what, RigTime now) { log.Write(now, "motor", what); });
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
  if (laser_) {
    scene.laser_mount = laser_->mount();
    scene.laser_level = laser_->MeanLevel(from, to);
    // Whole nanoradians: where the motor stood when the laser was mounted leaves rounding errors, and
    // equal commands must give equal pixels.
    constexpr double kTiltStep_rad = 1e-9;
    if (scene.laser_level > 0) {
      scene.laser_tilt_rad = std::round(laser_->Tilt(middle) / kTiltStep_rad) * kTiltStep_rad;
    }
    scene.key.laser_level = scene.laser_level;
    scene.key.laser_tilt_rad = scene.laser_tilt_rad;
  }
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
