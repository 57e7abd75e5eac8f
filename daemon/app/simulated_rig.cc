#include "daemon/app/simulated_rig.h"

#include "protocol/base/runtime_dir.h"
#include "protocol/wire/channel.h"

namespace mesorig::daemon {

StatusOr<std::unique_ptr<SimulatedRig>> SimulatedRig::Connect(
    const std::filesystem::path& runtime_dir, const Rig& rig) {
  if (rig.buses.any()) {
    return Unimplemented("rig {}: [buses] names real ones, and mesorigd has no ports for them yet",
                         rig.name);
  }
  const auto endpoint = FindEndpoint(runtime_dir, wire::kSimulatorName);
  if (!endpoint.ok()) {
    return Unimplemented(
        "rigs on real buses are not there yet, and {}; start `mesorig-sim run` "
        "first",
        Message(endpoint.status()));
  }
  MESORIG_ASSIGN_OR_RETURN(auto link, sim_wire::SimLink::Connect(*endpoint));
  if (const std::string& simulated = link->welcome().rig_sha256; simulated != rig.sha256) {
    return FailedPrecondition("{} simulates another rig: SHA-256 of its file is {}, of this one {}",
                              wire::kSimulatorName, simulated, rig.sha256);
  }
  std::unique_ptr<SimulatedRig> simulated(new SimulatedRig(std::move(link), rig));
  MESORIG_RETURN_IF_ERROR(simulated->OpenBuses());
  MESORIG_RETURN_IF_ERROR(simulated->MakeDevices());
  return simulated;
}

Status SimulatedRig::OpenBuses() {
  MESORIG_ASSIGN_OR_RETURN(can_port_, SimCanPort::Open(*link_));
  MESORIG_ASSIGN_OR_RETURN(line_port_, SimLinePort::Open(*link_));
  if (rig_.laser) {
    MESORIG_ASSIGN_OR_RETURN(usb_port_, SimUsbPort::Open(*link_));
  }
  CanBusOptions can_options;
  can_options.heartbeat = FromSeconds(rig_.heartbeat_s);
  can_ = std::make_unique<CanBus>(*link_, *can_port_, can_options);
  ModbusBusOptions modbus_options;
  modbus_options.unit = rig_.lamp_bank.unit;
  // Often enough that one lost telegram does not put the lamps out.
  modbus_options.keep_alive = FromSeconds(rig_.lamp_bank.timeout_s / 3);
  MESORIG_ASSIGN_OR_RETURN(
      modbus_, ModbusBus::Connect(*link_, link_->welcome().modbus_endpoint, modbus_options));
  return OkStatus();
}

Status SimulatedRig::MakeDevices() {
  DriverContext context;
  context.clock = link_.get();
  context.rig = &rig_;
  context.stop = &stop_;
  context.can = can_.get();
  context.modbus = modbus_.get();
  context.lines = line_port_.get();
  context.usb = usb_port_.get();
  context.simulator = link_.get();
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
  sequencer_ = Sequencer::Create(*link_, rig_, std::move(devices),
                                 [link = link_.get()] { return link->deterministic(); });
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
  manual_ = ManualControl::Create(*link_, rig_, std::move(by_hand));
  return OkStatus();
}

}  // namespace mesorig::daemon
