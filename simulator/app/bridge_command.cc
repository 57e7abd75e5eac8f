#include <CLI/CLI.hpp>
#include <csignal>
#include <memory>

#include "protocol/base/log.h"
#include "protocol/base/runtime_dir.h"
#include "simulator/app/commands.h"
#include "simulator/bridge/can_bridge.h"

namespace mesorig::simulator {
namespace {

struct BridgeOptions {
  std::string runtime_dir = DefaultRuntimeDir().string();
  std::string can;
};

Status Bridge(const BridgeOptions& options) {
  StartLogging("mesorig-sim");
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);  // in all threads; waited for below
  MESORIG_ASSIGN_OR_RETURN(const std::string endpoint,
                           FindEndpoint(options.runtime_dir, "mesorig-sim"));
  MESORIG_ASSIGN_OR_RETURN(auto link, sim_wire::SimLink::Connect(endpoint));
  MESORIG_ASSIGN_OR_RETURN(const auto can, CanBridge::Open(*link, options.can));
  const RigClock::Activity time_passes(*link, Pace::kRealTime);
  spdlog::info("the simulated axes are on {}", options.can);
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
  bridge->add_option("--can", options->can, "CAN interface for the axes (vcan0)")->required();
  return {bridge, [options] { return Bridge(*options); }};
}

}  // namespace mesorig::simulator
