#include <CLI/CLI.hpp>
#include <csignal>
#include <memory>
#include <thread>

#include "protocol/base/log.h"
#include "protocol/base/runtime_dir.h"
#include "simulator/app/commands.h"
#include "simulator/app/world_rig.h"
#include "simulator/devices/faults/fault_script.h"
#include "simulator/devices/lamp_slave/lamp_slave.h"
#include "simulator/world/sample.h"

namespace mesorig::simulator {
namespace {

struct RunOptions {
  std::string rig, sample;
  std::string runtime_dir = DefaultRuntimeDir().string();
  uint64_t seed = 1;
  int samples_per_side = 2;
  int cache_mb = 512;
  std::string log, faults;
  bool no_reset = false;
};

// SIGINT and SIGTERM, waited for by a thread of its own: handlers can do next to nothing.
class StopOnSignal {
 public:
  explicit StopOnSignal(sim_wire::SimServer& server) {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGINT);
    sigaddset(&signals_, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
    thread_ = std::thread([this, &server] {
      int signal = 0;
      sigwait(&signals_, &signal);
      server.Stop();
    });
  }
  ~StopOnSignal() {
    pthread_kill(thread_.native_handle(), SIGTERM);  // in case the server ended by itself
    thread_.join();
  }

 private:
  sigset_t signals_{};
  std::thread thread_;
};

Status Run(const RunOptions& options) {
  StartLogging("mesorig-sim");
  MESORIG_ASSIGN_OR_RETURN(const Rig rig, LoadRig(options.rig));
  MESORIG_ASSIGN_OR_RETURN(world::Sample sample, world::LoadSample(options.sample));
  std::vector<sim_wire::TimedInjection> script;
  if (!options.faults.empty()) {
    MESORIG_ASSIGN_OR_RETURN(script, LoadFaultScript(options.faults, rig));
  }
  MESORIG_ASSIGN_OR_RETURN(auto endpoint,
                           PublishedEndpoint::Claim(options.runtime_dir, "mesorig-sim"));
  MESORIG_ASSIGN_OR_RETURN(const auto world, world::World::Build(std::move(sample.surface)));
  world::ImageOptions image_options;
  image_options.samples_per_side = options.samples_per_side;
  image_options.cache_bytes = static_cast<size_t>(options.cache_mb) << 20;
  std::unique_ptr<RigLog> log;
  if (!options.log.empty()) {
    MESORIG_ASSIGN_OR_RETURN(log, RigLog::Create(options.log));
  }
  WorldRig world_rig(rig, *world, options.seed, image_options, log.get(),
                     !options.no_reset);
  MESORIG_ASSIGN_OR_RETURN(auto slave, LampSlave::Listen(world_rig.lamps(), rig.lamp_bank.unit,
                                                        world_rig.devices().Find("lamps")));
  MESORIG_ASSIGN_OR_RETURN(auto listener, sim_wire::Listen(endpoint.socket_path()));
  sim_wire::SimServerOptions server_options;
  server_options.welcome.rig_sha256 = rig.sha256;
  server_options.welcome.seed = options.seed;
  server_options.welcome.modbus_endpoint = slave->endpoint();
  server_options.script = std::move(script);
  server_options.on_injection = [&log](RigTime now, std::string_view text, const Status& status) {
    if (!status.ok()) return;
    spdlog::info("at {:.3f} s: {}", Seconds(now), text);
    if (log) log->Write(now, "injected", text);
  };
  sim_wire::SimServer server(std::move(listener), world_rig.devices().All(), server_options);
  StopOnSignal stop(server);
  slave->Start(server);
  Status status = endpoint.Publish("unix:" + endpoint.socket_path().string());
  if (status.ok()) {
    spdlog::info("rig {} with {}, seed {}, in {}", rig.name, options.sample, options.seed,
                 options.runtime_dir);
    status = server.Run();
  }
  slave.reset();  // before the server that it enters
  return status;
}

}  // namespace

Command AddRunCommand(CLI::App& app) {
  auto options = std::make_shared<RunOptions>();  // lives as long as the parsed command
  CLI::App* run = app.add_subcommand("run", "Serve the simulated rig until interrupted");
  run->add_option("--rig", options->rig, "Rig file (rigs/*.toml)")->required();
  run->add_option("--sample", options->sample, "Sample file (rigs/samples/*.toml)")->required();
  run->add_option("--runtime-dir", options->runtime_dir, "Where programs find each other")
      ->capture_default_str();
  run->add_option("--seed", options->seed, "Equal seeds give equal pixels")->capture_default_str();
  run->add_option("--samples-per-side", options->samples_per_side,
                  "Rays a pixel along each side: more is slower and smoother")
      ->check(CLI::Range(1, 16))
      ->capture_default_str();
  run->add_option("--cache-mb", options->cache_mb,
                  "Memory for what the cameras' rays met: eight views of a turntable position "
                  "should fit")
      ->check(CLI::Range(16, 1 << 20))
      ->capture_default_str();
  run->add_option("--faults", options->faults,
                  "Script of faults: lines `at SECONDS DEVICE FAULT...` in virtual time\n"
                  "(`mesorig-sim inject --help` lists the faults)");
  run->add_flag("--no-reset", options->no_reset,
                "Begin as a rig that was just switched on: nothing has power until somebody presses\n"
                "reset (`mesorig-sim inject lines reset`); otherwise somebody has");
  run->add_option("--log", options->log,
                  "Write what really happens at the rig: laser, lamps, torque, axes, contactor, mount, faults "
                  "(tab-separated, one line an event)");
  return {run, [options] { return Run(*options); }};
}

}  // namespace mesorig::simulator
