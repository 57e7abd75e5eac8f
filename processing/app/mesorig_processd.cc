// mesorig-processd: turns the daemon's sessions into products.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <thread>

#include "processing/service/processing_server.h"
#include "protocol/base/frame_memory.h"
#include "protocol/base/log.h"
#include "protocol/base/program.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/base/service_manager.h"

namespace mesorig {
namespace {

// Libraries start threads before main, which would take a blocked signal with its default action:
// so signals are handled, and pass through a pipe.
int g_signal_pipe[2] = {-1, -1};

void OnSignal(int) {
  const int saved = errno;
  (void)!::write(g_signal_pipe[1], "s", 1);
  errno = saved;
}

Status CatchSignals() {
  if (::pipe(g_signal_pipe) != 0) return Internal("pipe: {}", std::strerror(errno));
  struct sigaction action {};
  action.sa_handler = OnSignal;
  action.sa_flags = SA_RESTART;
  ::sigaction(SIGTERM, &action, nullptr);
  ::sigaction(SIGINT, &action, nullptr);
  return OkStatus();
}

Status Serve(const service::ServerOptions& options) {
  MESORIG_RETURN_IF_ERROR(CatchSignals());
  const ServiceManager manager;
  MESORIG_ASSIGN_OR_RETURN(const auto server, service::ProcessingServer::Start(options));
  std::thread stopper([&] {
    char byte = 0;
    while (::read(g_signal_pipe[0], &byte, 1) < 0 && errno == EINTR) continue;
    server->Stop();
  });
  Log("processing").info("products go to {}", options.products_dir.string());
  (void)manager.Ready("follows mesorigd");
  const Status status = server->Run();
  (void)manager.Stopping("ending");
  OnSignal(SIGTERM);  // wakes the stopper where no signal did
  stopper.join();
  return status;
}

}  // namespace
}  // namespace mesorig

int main(int argc, char** argv) {
  CLI::App app(
      "Processing service of mesorig: follows the sessions of mesorigd and leaves\n"
      "DIR/<session>/sample.btf.exr for each one that is complete. Runs until SIGTERM.");
  mesorig::service::ServerOptions options;
  options.runtime_dir = mesorig::DefaultRuntimeDir();
  app.add_option("--runtime-dir", options.runtime_dir,
                 "where mesorigd publishes itself, and this service too")
      ->capture_default_str();
  app.add_option("--products", options.products_dir, "where the products go")
      ->required()
      ->type_name("DIR");
  app.add_option("--connect-timeout", options.connect_timeout_s,
                 "seconds to wait for mesorigd at the start")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app.add_option("--patience", options.patience_s,
                 "seconds that mesorigd may be away during a session before it is given up")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  mesorig::LogOptions log;
  std::string format = "text";
  app.add_option("--log-level", log.levels, "info, or info,processing=debug,...: a level a part")
      ->capture_default_str();
  app.add_option("--log-format", format, "text or json")->check(CLI::IsMember({"text", "json"}));
  return mesorig::RunProgram(app, "mesorig-processd", argc, argv, [&]() -> mesorig::Status {
    mesorig::StartLogging("mesorig-processd");
    if (format == "json") log.format = mesorig::LogFormat::kJson;
    if (app.count("--log-level") + app.count("--log-format") > 0) {
      MESORIG_RETURN_IF_ERROR(mesorig::SetLogging(log));
    }
    mesorig::KeepFreedFrames();
    return mesorig::Serve(options);
  });
}
