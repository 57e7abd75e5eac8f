#pragma once
// The whole simulated rig: world, plant and devices behind one dispatcher.

#include <memory>
#include <vector>

#include "protocol/rig/rig.h"
#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/camera/camera_device.h"
#include "simulator/devices/cia402_node/can_bus.h"
#include "simulator/devices/contactor.h"
#include "simulator/devices/digital_lines/digital_lines.h"
#include "simulator/devices/faults/faulty_device.h"
#include "simulator/devices/lamp_slave/lamp_bank_model.h"
#include "simulator/devices/laser_unit/laser_unit.h"
#include "simulator/devices/nxt_brick/nxt_brick.h"
#include "simulator/devices/rig_log.h"
#include "simulator/world/camera_image.h"
#include "simulator/world/world.h"

namespace mesorig::simulator {

// Owns all devices; the world, the rig and the log are borrowed. Called by the dispatcher only.
class WorldRig final : public ImageSource {
 public:
  // log: optional. reset_pressed: somebody did after switching the rig on, so that its contactor is
  // closed.
  WorldRig(const Rig& rig, const world::World& world, uint64_t seed, world::ImageOptions options,
           RigLog* log = nullptr, bool reset_pressed = true);

  // In the order of effects within an instant: can, lamps, nxt (with a laser), lines, cameras.
  // Each with what can go wrong on its way around it.
  FaultyDevices& devices() { return *devices_; }
  LampBankModel& lamps() { return lamps_; }

  Scene Observe(RigTime from, RigTime to) override;
  StatusOr<std::vector<float>> ExpectedElectrons(int camera, const Scene& scene,
                                                 double exposure_s) override;

 private:
  void LogTo(RigLog& log);

  const Rig& rig_;
  const uint64_t seed_;
  Contactor contactor_;
  CanBusDevice can_;
  LampBankModel lamps_;
  std::unique_ptr<LaserUnit> laser_;  // with its brick; none in a rig that has none
  std::unique_ptr<NxtBrick> brick_;
  DigitalLinesDevice lines_;
  std::vector<std::unique_ptr<CameraDevice>> cameras_;
  std::unique_ptr<FaultyDevices> devices_;
  world::CameraImages images_;
};

}  // namespace mesorig::simulator
