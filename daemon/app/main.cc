// mesorigd: the acquisition daemon.

#include <CLI/CLI.hpp>

#include "daemon/app/access_options.h"
#include "daemon/app/check_settings.h"
#include "daemon/app/serve.h"
#include "protocol/base/frame_memory.h"
#include "protocol/base/program.h"
#include "protocol/base/runtime_dir.h"

namespace mesorig::daemon {
namespace {

// What the command line says; empty: nothing.
struct CommandLine {
  std::string config, rig, state_dir, runtime_dir, log_levels, log_format;
  AccessOptions access;
  int metrics_port = -1;
  bool check = false;
};

void AddOptions(CLI::App& app, CommandLine& line) {
  app.add_option("--config", line.config, "Settings (docs/operations.md); options here outrank it")
      ->type_name("FILE");
  app.add_option("--rig", line.rig, "Rig file (rigs/*.toml)");
  app.add_option("--state-dir", line.state_dir, "Where sessions are kept, a folder each");
  app.add_option("--runtime-dir", line.runtime_dir,
                 fmt::format("Where programs find each other [{}]", DefaultRuntimeDir().string()));
  app.add_option("--log-level", line.log_levels, "info, or info,safety=debug,...: a level a part");
  app.add_option("--log-format", line.log_format, "text or json")
      ->check(CLI::IsMember({"text", "json"}));
  app.add_option("--metrics-port", line.metrics_port,
                 "Figures for Prometheus at 127.0.0.1; 0: any free port, published in the runtime "
                 "directory")
      ->check(CLI::Range(0, 65535));
  AddAccessOptions(app, line.access);
  app.add_flag("--check-config", line.check, "Say what would be used and what is wrong, and end");
}

// The file, then the command line.
StatusOr<Settings> Gather(const CommandLine& line) {
  Settings settings;
  settings.runtime_dir = DefaultRuntimeDir().string();
  if (!line.config.empty()) MESORIG_RETURN_IF_ERROR(ReadSettings(line.config, settings));
  const auto take = [](const std::string& from, std::string& to) {
    if (!from.empty()) to = from;
  };
  take(line.rig, settings.rig);
  take(line.state_dir, settings.state_dir);
  take(line.runtime_dir, settings.runtime_dir);
  take(line.log_levels, settings.log.levels);
  if (!line.log_format.empty()) {
    settings.log.format = line.log_format == "json" ? LogFormat::kJson : LogFormat::kText;
  }
  if (!line.access.listen.empty()) settings.access.listen = line.access.listen;
  if (!line.access.tls_dir.empty()) settings.access.tls_dir = line.access.tls_dir;
  for (const auto& [role, group] : line.access.groups) settings.access.groups[role] = group;
  if (line.access.gate.max_certificate_days != GateOptions().max_certificate_days) {
    settings.access.gate.max_certificate_days = line.access.gate.max_certificate_days;
  }
  if (line.metrics_port >= 0) settings.metrics_port = line.metrics_port;
  if (settings.rig.empty()) return InvalidArgument("--rig is required, or rig = in --config");
  if (settings.state_dir.empty()) {
    return InvalidArgument("--state-dir is required, or state_dir = in --config");
  }
  MESORIG_RETURN_IF_ERROR(CheckLogging(settings.log));
  return settings;
}

}  // namespace
}  // namespace mesorig::daemon

int main(int argc, char** argv) {
  using namespace mesorig;
  CLI::App app{
      "Acquisition daemon: owns the rig's hardware, runs plans, keeps journal and frames.\n"
      "The rig is mesorig-sim in the same runtime directory; `mesorig` talks to it.\n"
      "SIGTERM or SIGINT stop a running plan (lamps off) and end it; SIGHUP reads --config anew."};
  daemon::CommandLine line;
  daemon::AddOptions(app, line);
  return RunProgram(app, "mesorigd", argc, argv, [&]() -> Status {
    MESORIG_ASSIGN_OR_RETURN(const daemon::Settings settings, daemon::Gather(line));
    if (line.check) return daemon::CheckSettings(settings);
    KeepFreedFrames();
    return daemon::Serve(settings, [&] { return daemon::Gather(line); });
  });
}
