#include "daemon/app/serve.h"

#include <unistd.h>

#include <chrono>
#include <csignal>
#include <thread>

#include "daemon/app/simulated_rig.h"
#include "daemon/service/access.h"
#include "daemon/service/daemon_service.h"
#include "protocol/base/log.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/wire/channel.h"
#include "protocol/wire/server.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kLook{100};  // how often the supervisor looks
constexpr std::chrono::seconds kPlanEnds{4};     // a stopped plan's wind-down and flush
constexpr std::chrono::seconds kCallsEnd{1};     // clients' calls
constexpr std::chrono::seconds kLastResort{15};  // then the process ends anyhow

class Signals {
 public:
  Signals() {
    sigemptyset(&set_);
    sigaddset(&set_, SIGTERM);
    sigaddset(&set_, SIGINT);
    pthread_sigmask(SIG_BLOCK, &set_, nullptr);
    std::signal(SIGPIPE, SIG_IGN);
  }
  // The signal that came, or 0 after `timeout`.
  int Wait(std::chrono::nanoseconds timeout) const {
    timespec span{};
    span.tv_nsec = timeout.count();
    const int signal = ::sigtimedwait(&set_, nullptr, &span);
    return signal > 0 ? signal : 0;
  }

 private:
  sigset_t set_{};
};

bool Runs(const Sequencer& sequencer) { return InSession(sequencer.GetStatus().state); }

// Whatever hangs: lamps have a communication-loss timeout, drives a heartbeat, and the ledger
// survives a kill.
void EndAnyhow() {
  std::thread([] {
    std::this_thread::sleep_for(kLastResort);
    Log("program").critical("the shutdown hangs: ending without it");
    ::_exit(1);
  }).detach();
}

void StopPlan(Sequencer& sequencer, std::string_view reason) {
  if (!Runs(sequencer)) return;
  if (const Status status = sequencer.Stop(reason); !status.ok()) {
    Log("program").error("{}", Message(status));
  }
  const auto deadline = HostClock::now() + kPlanEnds;
  while (Runs(sequencer) && HostClock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  if (Runs(sequencer)) Log("program").error("the plan did not end within {} s", kPlanEnds.count());
}

// Until a signal comes. Returns the fault, if one came before.
Status Supervise(const Signals& signals, const SimulatedRig& rig, DaemonService& service) {
  Status fault;
  for (;;) {
    if (const int signal = signals.Wait(kLook); signal != 0) {
      Log("program").info("{}: ending", signal == SIGTERM ? "SIGTERM" : "SIGINT");
      return fault;
    }
    if (!fault.ok()) continue;
    fault = rig.health();
    if (fault.ok()) continue;
    Log("program").critical("{}", Message(fault));
    service.ReportFault(Message(fault));
  }
}

}  // namespace

Status Serve(const ServeOptions& options) {
  const Signals signals;
  wire::PrepareGrpc();
  StartLogging("mesorigd");
  MESORIG_ASSIGN_OR_RETURN(const Rig rig_description, LoadRig(options.rig));
  MESORIG_ASSIGN_OR_RETURN(PublishedEndpoint endpoint,
                           PublishedEndpoint::Claim(options.runtime_dir, wire::kDaemonName));
  MESORIG_ASSIGN_OR_RETURN(const auto rig,
                           SimulatedRig::Connect(options.runtime_dir, rig_description));
  MESORIG_ASSIGN_OR_RETURN(const auto service,
                           DaemonService::Create(rig_description, rig->sequencer(),
                                                 options.state_dir, &rig->manual()));
  if (Safety* safety = rig->sequencer().safety()) {
    MESORIG_RETURN_IF_ERROR(
        safety->KeepLampHours(std::filesystem::path(options.state_dir) / "lamp_hours.tsv"));
  }
  AccessOptions access_options = options.access;
  access_options.audit = &service->audit();
  MESORIG_ASSIGN_OR_RETURN(const auto access,
                           Access::Create(access_options, endpoint, service->services()));
  Log("program").info("rig {} ({}), sessions in {}, at {}{}", rig_description.name, options.rig,
               options.state_dir, endpoint.socket_path().parent_path().string(),
               access->address().empty() ? "" : " and with TLS at " + access->address());

  const Status fault = Supervise(signals, *rig, *service);
  EndAnyhow();
  StopPlan(rig->sequencer(), "mesorigd was told to end");
  service->BeginShutdown();
  access->Shutdown(std::chrono::system_clock::now() + kCallsEnd);
  return fault;
}

}  // namespace mesorig::daemon
