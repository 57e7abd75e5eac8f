#include <CLI/CLI.hpp>
#include <csignal>
#include <memory>

#include "protocol/base/log.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/rig/rig.h"
#include "simulator/app/commands.h"
#include "simulator/bridge/can_bridge.h"
#include "simulator/bridge/gpio_bridge.h"
#include "simulator/bridge/modbus_bridge.h"
#include "simulator/bridge/usb_bridge.h"

namespace mesorig::simulator {
namespace {

struct BridgeOptions {
  std::string runtime_dir = DefaultRuntimeDir().string();
  std::string can, modbus, gpio, rig;
  int usb = 0;  // port; 0: not asked for
};

GpioBridgeOptions LinesOf(const Rig& rig, const std::string& label) {
  GpioBridgeOptions options;
  options.label = label;
  const Lines& lines = rig.lines;
  for (const int line : {lines.estop, lines.door, lines.reset, lines.laser_on, lines.power}) {
    if (line >= 0) options.inputs.push_back(line);
  }
  if (lines.laser_trigger >= 0) options.outputs.push_back(lines.laser_trigger);
  return options;
}

Status Bridge(const BridgeOptions& options) {
  if (options.can.empty() && options.modbus.empty() && options.gpio.empty() && options.usb == 0) {
    return InvalidArgument("--can, --modbus, --gpio or --usb is needed");
  }
  StartLogging("mesorig-sim");
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);  // in all threads; waited for below
  MESORIG_ASSIGN_OR_RETURN(const std::string endpoint,
                           FindEndpoint(options.runtime_dir, "mesorig-sim"));
  SystemRigClock clock;
  sim_wire::SimLinkOptions live;
  live.live = &clock;
  MESORIG_ASSIGN_OR_RETURN(auto link, sim_wire::SimLink::Connect(endpoint, live));
  std::unique_ptr<CanBridge> can;
  std::unique_ptr<ModbusBridge> modbus;
  std::unique_ptr<GpioBridge> gpio;
  std::unique_ptr<UsbBridge> usb;
  if (!options.can.empty()) {
    MESORIG_ASSIGN_OR_RETURN(can, CanBridge::Open(*link, options.can));
    spdlog::info("the simulated axes are on {}", options.can);
  }
  if (!options.modbus.empty()) {
    MESORIG_ASSIGN_OR_RETURN(
        modbus, ModbusBridge::Open(options.modbus, link->welcome().modbus_endpoint));
    spdlog::info("the simulated lamps are on {}", options.modbus);
  }
  if (!options.gpio.empty()) {
    MESORIG_ASSIGN_OR_RETURN(const Rig rig, LoadRig(options.rig));
    MESORIG_ASSIGN_OR_RETURN(gpio, GpioBridge::Open(*link, LinesOf(rig, options.gpio)));
    spdlog::info("the simulated lines are on {}", options.gpio);
  }
  if (options.usb != 0) {
    MESORIG_ASSIGN_OR_RETURN(const Rig rig, LoadRig(options.rig));
    if (!rig.buses.usb) return InvalidArgument("{}: [buses.usb] names no serial number", options.rig);
    MESORIG_ASSIGN_OR_RETURN(usb, UsbBridge::Open(*link, options.usb, rig.buses.usb->serial));
    spdlog::info("the simulated brick is at 127.0.0.1:{} (USB/IP)", options.usb);
  }
  spdlog::info("all bridges stand");
  while (link->health().ok()) {
    constexpr timespec kLook{1, 0};
    if (sigtimedwait(&signals, nullptr, &kLook) > 0) return OkStatus();
  }
  return link->health();
}

}  // namespace

Command AddBridgeCommand(CLI::App& app) {
  auto options = std::make_shared<BridgeOptions>();  // lives as long as the parsed command
  CLI::App* bridge = app.add_subcommand(
      "bridge", "Put devices of a running simulation on interfaces of the kernel, in real time");
  bridge->add_option("--runtime-dir", options->runtime_dir, "That of `mesorig-sim run`")
      ->capture_default_str();
  bridge->add_option("--can", options->can, "CAN interface for the axes (vcan0)");
  bridge->add_option("--modbus", options->modbus,
                     "Serial line for the lamps: becomes a link to a pseudo-terminal (Modbus RTU)");
  CLI::Option* const rig = bridge->add_option("--rig", options->rig, "Rig file, for --gpio and --usb");
  bridge->add_option("--gpio", options->gpio, "Label of a chip of gpio-sim, for the lines")->needs(rig);
  bridge->add_option("--usb", options->usb, "Port of 127.0.0.1 for the laser's brick (USB/IP; 3240)")
      ->check(CLI::Range(1, 65535))->needs(rig);
  return {bridge, [options] { return Bridge(*options); }};
}

}  // namespace mesorig::simulator
