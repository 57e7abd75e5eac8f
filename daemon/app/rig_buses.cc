#include "daemon/app/rig_buses.h"

#include <unistd.h>

#include "daemon/bus/gpio_line_port.h"
#include "daemon/bus/libusb_port.h"
#include "daemon/bus/sim_can_port.h"
#include "daemon/bus/sim_line_port.h"
#include "daemon/bus/sim_usb_port.h"
#include "daemon/bus/socketcan_port.h"
#include "protocol/base/log.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/wire/channel.h"

namespace mesorig::daemon {
namespace {

// LEGO MINDSTORMS NXT Hardware Developer Kit: the brick's endpoints.
const UsbKind kNxtBrick{"NXT brick", 0x0694, 0x0002, 0x01, 0x82};

}  // namespace

StatusOr<std::unique_ptr<RigBuses>> RigBuses::Open(const std::filesystem::path& runtime_dir,
                                                   const Rig& rig) {
  std::unique_ptr<RigBuses> buses(new RigBuses(rig));
  MESORIG_RETURN_IF_ERROR(buses->FindSimulator(runtime_dir));
  MESORIG_RETURN_IF_ERROR(buses->OpenCan());
  MESORIG_RETURN_IF_ERROR(buses->OpenLines());
  if (rig.laser) MESORIG_RETURN_IF_ERROR(buses->OpenUsb());
  return buses;
}

Status RigBuses::FindSimulator(const std::filesystem::path& runtime_dir) {
  const auto endpoint = FindEndpoint(runtime_dir, wire::kSimulatorName);
  if (!endpoint.ok()) {
    return Unimplemented("cameras have only a simulated end yet, and {}; start `mesorig-sim run` first",
                         Message(endpoint.status()));
  }
  sim_wire::SimLinkOptions options;
  if (real_) options.live = &system_clock_;
  MESORIG_ASSIGN_OR_RETURN(link_, sim_wire::SimLink::Connect(*endpoint, options));
  if (const std::string& simulated = link_->welcome().rig_sha256; simulated != rig_.sha256) {
    return FailedPrecondition("{} simulates another rig: SHA-256 of its file is {}, of this one {}",
                              wire::kSimulatorName, simulated, rig_.sha256);
  }
  clock_ = real_ ? static_cast<RigClock*>(&system_clock_) : link_.get();
  return OkStatus();
}

Status RigBuses::OpenCan() {
  if (!rig_.buses.can) {
    MESORIG_ASSIGN_OR_RETURN(can_, SimCanPort::Open(*link_));
    return OkStatus();
  }
  const Buses::Can& where = *rig_.buses.can;
  MESORIG_ASSIGN_OR_RETURN(auto port, SocketCanPort::Open(*clock_, where.interface));
  if (const Status up = port->Health(); !up.ok()) {
    Log("bus").warn("{}; to bring it up: ip link set {} up{}", Message(up), where.interface,
                    where.bitrate == 0
                        ? ""
                        : fmt::format(" type can bitrate {} restart-ms 100", where.bitrate));
  }
  can_ = std::move(port);
  return OkStatus();
}

Status RigBuses::OpenLines() {
  if (!rig_.buses.gpio) {
    MESORIG_ASSIGN_OR_RETURN(lines_, SimLinePort::Open(*link_));
    return OkStatus();
  }
  GpioLineOptions options;
  options.chip = rig_.buses.gpio->chip;
  options.names = rig_.buses.gpio->names;
  // The kernel tells it to whoever asks for one of these lines.
  options.consumer = fmt::format("mesorigd, process {}", ::getpid());
  const Lines& lines = rig_.lines;
  for (const int line : {lines.estop, lines.door, lines.reset, lines.laser_on, lines.power}) {
    if (line >= 0) options.inputs.push_back(line);
  }
  if (lines.laser_trigger >= 0) options.outputs.push_back(lines.laser_trigger);
  MESORIG_ASSIGN_OR_RETURN(lines_, GpioLinePort::Open(*clock_, std::move(options)));
  return OkStatus();
}

Status RigBuses::OpenUsb() {
  if (!rig_.buses.usb) {
    MESORIG_ASSIGN_OR_RETURN(usb_, SimUsbPort::Open(*link_));
    return OkStatus();
  }
  MESORIG_ASSIGN_OR_RETURN(auto port,
                           LibusbPort::Open(*clock_, kNxtBrick, rig_.buses.usb->serial));
  if (const Status there = port->Health(); !there.ok()) Log("bus").warn("{}", Message(there));
  usb_ = std::move(port);
  return OkStatus();
}

StatusOr<std::unique_ptr<ModbusBus>> RigBuses::ConnectModbus(const ModbusBusOptions& options) {
  if (rig_.buses.modbus) return ModbusBus::Open(*clock_, *rig_.buses.modbus, options);
  return ModbusBus::Connect(*clock_, link_->welcome().modbus_endpoint, options);
}

}  // namespace mesorig::daemon
