// mesorigd: the acquisition daemon.

#include <CLI/CLI.hpp>

#include "daemon/app/access_options.h"
#include "daemon/app/serve.h"
#include "protocol/base/program.h"
#include "protocol/base/runtime_dir.h"

int main(int argc, char** argv) {
  using namespace mesorig;
  CLI::App app{
      "Acquisition daemon: owns the rig's hardware, runs plans, keeps journal and frames.\n"
      "The rig is mesorig-sim in the same runtime directory; `mesorig` talks to it.\n"
      "SIGTERM or SIGINT stop a running plan (lamps off) and end it."};
  daemon::ServeOptions options;
  options.runtime_dir = DefaultRuntimeDir().string();
  app.add_option("--rig", options.rig, "Rig file (rigs/*.toml)")->required();
  app.add_option("--state-dir", options.state_dir, "Where sessions are kept, a folder each")
      ->required();
  app.add_option("--runtime-dir", options.runtime_dir, "Where programs find each other")
      ->capture_default_str();
  daemon::AddAccessOptions(app, options.access);
  return RunProgram(app, "mesorigd", argc, argv, [&] { return daemon::Serve(options); });
}
