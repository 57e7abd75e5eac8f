#include "daemon/app/attached_rig.h"

namespace mesorig::daemon {

StatusOr<std::unique_ptr<AttachedRig>> AttachedRig::Connect(
    const std::filesystem::path& runtime_dir, const Rig& rig) {
  MESORIG_ASSIGN_OR_RETURN(auto buses, RigBuses::Open(runtime_dir, rig));
  std::unique_ptr<AttachedRig> attached(new AttachedRig(std::move(buses), rig));
  MESORIG_RETURN_IF_ERROR(attached->StartBuses());
  MESORIG_RETURN_IF_ERROR(attached->MakeDevices());
  return attached;
}

Status AttachedRig::StartBuses() {
  CanBusOptions can_options;
  can_options.heartbeat = FromSeconds(rig_.heartbeat_s);
  can_ = std::make_unique<CanBus>(clock_, buses_->can(), can_options);
  ModbusBusOptions modbus_options;
  modbus_options.unit = rig_.lamp_bank.unit;
  // Often enough that one lost telegram does not put the lamps out.
  modbus_options.keep_alive = FromSeconds(rig_.lamp_bank.timeout_s / 3);
  MESORIG_ASSIGN_OR_RETURN(modbus_, buses_->ConnectModbus(modbus_options));
  return OkStatus();
}

Status AttachedRig::MakeDevices() {
  DriverContext context;
  context.clock = &clock_;
  context.rig = &rig_;
  context.stop = &stop_;
  context.can = can_.get();
  context.modbus = modbus_.get();
  context.lines = &buses_->lines();
  context.usb = buses_->usb();
  context.simulator = buses_->simulator();
  Devices devices;
  for (size_t i = 0; i < rig_.axes.size(); ++i) {
    MESORIG_ASSIGN_OR_RETURN(auto axis, MakeAxis("cia402", context, static_cast<int>(i)));
    devices.axes.push_back(axis.get());
    axes_.push_back(std::move(axis));
  }
  for (size_t i = 0; i < rig_.cameras.size(); ++i) {
    MESORIG_ASSIGN_OR_RETURN(auto camera, MakeCamera("sim_camera", context, static_cast<int>(i)));
    devices.cameras.push_back(camera.get());
    cameras_.push_back(std::move(camera));
  }
  MESORIG_ASSIGN_OR_RETURN(lamps_, MakeLampBank("modbus_lamps", context));
  MESORIG_ASSIGN_OR_RETURN(lines_, MakeDigitalLines("gpio_lines", context));
  if (rig_.laser) {
    MESORIG_ASSIGN_OR_RETURN(laser_, MakeLineLaser("nxt_laser", context));
  }
  devices.laser = laser_.get();
  devices.lamps = lamps_.get();
  devices.lines = lines_.get();
  devices.stop = &stop_;
  sequencer_ = Sequencer::Create(clock_, rig_, std::move(devices),
                                 [buses = buses_.get()] { return buses->deterministic(); });
  manual_ = ManualControl::Create(clock_, rig_, ByHand());
  return OkStatus();
}

ManualDevices AttachedRig::ByHand() {
  Safety& safety = *sequencer_->safety();
  ManualDevices by_hand;
  by_hand.axes = safety.axes();
  by_hand.lamps = safety.lamps();
  by_hand.gate = safety.gate();
  by_hand.stop = &stop_;
  by_hand.may_energise = [this, &safety] {
    const SequencerState state = sequencer_->GetStatus().state;
    if (state == SequencerState::kIdle) return safety.MayEnergise();
    return FailedPrecondition("nothing by hand while the daemon is {}", RowOf(state).name);
  };
  by_hand.alive = [&safety] { safety.Alive(); };
  by_hand.safety = &safety;
  return by_hand;
}

}  // namespace mesorig::daemon
