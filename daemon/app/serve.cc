#include "daemon/app/serve.h"

#include <unistd.h>

#include <chrono>
#include <csignal>
#include <thread>

#include "daemon/app/attached_rig.h"
#include "daemon/app/state_claim.h"
#include "daemon/app/supervision.h"
#include "daemon/service/access.h"
#include "daemon/service/daemon_service.h"
#include "daemon/service/stop_door.h"
#include "protocol/base/log.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/wire/channel.h"
#include "protocol/wire/health.h"
#include "protocol/wire/server.h"
#include "protocol/wire/stop_line.h"

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
    sigaddset(&set_, SIGHUP);
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

void StopPlan(AttachedRig& rig, std::string_view reason) {
  Sequencer& sequencer = rig.sequencer();
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

void Reload(Supervision& supervision, const ServiceManager& manager,
            const std::function<StatusOr<Settings>()>& reread) {
  (void)manager.Reloading();
  if (const auto settings = reread(); settings.ok()) {
    supervision.Reload(*settings);
  } else {
    Log("program").error("not reloaded: {}", Message(settings.status()));
  }
  (void)manager.Ready("reloaded");
}

// Stop comes in by a door of its own, too (wire/stop_line.h).
StatusOr<std::unique_ptr<StopDoor>> OpenStopDoor(const Settings& settings, Sequencer& sequencer,
                                                 AuditLog& audit) {
  StopDoorOptions options;
  for (const auto& [role, group] : settings.access.groups) options.groups.push_back(group);
  return StopDoor::Open(
      wire::StopSocket(settings.runtime_dir), std::move(options),
      [&](const std::vector<StopDoor::Order>& orders) {
        const StopDoor::Order& first = orders.front();
        const Status off = sequencer.Stop(first.reason.empty() ? "stopped by " + first.who
                                                               : "stopped: " + first.reason);
        for (const StopDoor::Order& order : orders) {
          Log("service").info("stop by {}: {}", order.who, order.reason);
          audit.RecordLater({{Role::kObserver, order.who, "stop socket", ""},
                             "Control/Stop", order.reason,
                             off.ok() ? "OK" : std::string(Message(off))});
        }
        return off;
      });
}

// Until a signal comes that ends it. Returns the fault, if one came before.
Status Supervise(const Signals& signals, const AttachedRig& rig, DaemonService& service,
                 Supervision& supervision, const ServiceManager& manager,
                 const std::function<StatusOr<Settings>()>& reread) {
  Status fault;
  for (;;) {
    supervision.Look();
    const int signal = signals.Wait(kLook);
    if (signal == SIGHUP) Reload(supervision, manager, reread);
    if (signal == SIGTERM || signal == SIGINT) {
      Log("program").info("{}: ending", signal == SIGTERM ? "SIGTERM" : "SIGINT");
      return fault.ok() ? rig.health() : fault;
    }
    if (!fault.ok()) continue;
    fault = rig.health();
    if (fault.ok()) continue;
    Log("program").critical("{}", Message(fault));
    service.ReportFault(Message(fault));
  }
}

}  // namespace

Status Serve(const Settings& settings, const std::function<StatusOr<Settings>()>& reread) {
  const Signals signals;
  wire::PrepareGrpc();
  StartLogging("mesorigd");
  MESORIG_RETURN_IF_ERROR(SetLogging(settings.log));
  const ServiceManager manager;
  MESORIG_ASSIGN_OR_RETURN(const Rig rig_description, LoadRig(settings.rig));
  MESORIG_ASSIGN_OR_RETURN(PublishedEndpoint endpoint,
                           PublishedEndpoint::Claim(settings.runtime_dir, wire::kDaemonName));
  MESORIG_ASSIGN_OR_RETURN(const FileClaim claim, ClaimState(settings.state_dir));
  MESORIG_ASSIGN_OR_RETURN(const auto rig,
                           AttachedRig::Connect(settings.runtime_dir, rig_description));
  MESORIG_ASSIGN_OR_RETURN(const auto service,
                           DaemonService::Create(rig_description, rig->sequencer(),
                                                 settings.state_dir, &rig->manual()));
  if (Safety* safety = rig->sequencer().safety()) {
    MESORIG_RETURN_IF_ERROR(
        safety->KeepLampHours(std::filesystem::path(settings.state_dir) / "lamp_hours.tsv"));
  }
  AccessOptions access_options = settings.access;
  access_options.audit = &service->audit();
  wire::EnableHealth();
  MESORIG_ASSIGN_OR_RETURN(const auto access,
                           Access::Create(access_options, endpoint, service->services()));
  MESORIG_ASSIGN_OR_RETURN(
      auto stop_door, OpenStopDoor(settings, rig->sequencer(), service->audit()));
  MESORIG_ASSIGN_OR_RETURN(auto supervision, Supervision::Start(settings, rig_description, *rig,
                                                                *service, *access, manager));
  Log("program").info("rig {} ({}), sessions in {}, at {}{}", rig_description.name, settings.rig,
                      settings.state_dir, endpoint.socket_path().parent_path().string(),
                      access->address().empty() ? "" : " and with TLS at " + access->address());
  if (const Status told = manager.Ready(fmt::format("serves rig {}", rig_description.name));
      !told.ok()) {
    Log("program").warn("systemd: {}", Message(told));
  }

  const Status fault = Supervise(signals, *rig, *service, *supervision, manager, reread);
  (void)manager.Stopping("ending");
  EndAnyhow();
  rig->Hurry();
  StopPlan(*rig, "mesorigd was told to end");
  stop_door.reset();
  service->BeginShutdown();
  access->Shutdown(std::chrono::system_clock::now() + kCallsEnd);
  supervision.reset();
  return fault;
}

}  // namespace mesorig::daemon
