#pragma once
// The gRPC services of mesorigd, Control, Frames and Operations, over one sequencer and one state
// folder: sessions, the audit log, the lease's tokens.

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/control/manual_control.h"
#include "daemon/control/sequencer.h"
#include "daemon/service/audit_log.h"
#include "protocol/rig/rig.h"

namespace grpc {
class Service;
}

namespace mesorig::v1 {
class StatusReply;
}

namespace mesorig::daemon {

class EventLog;

// A text of the support bundle.
struct DiagnosticFile {
  std::string name, content;
};

// Thread-safe. Outlives the grpc::Server that serves it.
class DaemonService {
 public:
  // Borrows rig, sequencer and manual control (null: nothing is done by hand), which outlive it;
  // takes their listeners. Errors of the audit log and of the lease's file.
  static StatusOr<std::unique_ptr<DaemonService>> Create(const Rig& rig, Sequencer& sequencer,
                                                         std::filesystem::path state_dir,
                                                         ManualControl* manual = nullptr);
  virtual ~DaemonService() = default;

  virtual std::vector<grpc::Service*> services() = 0;
  // What calls are recorded in: for Access.
  virtual AuditLog& audit() = 0;
  // What GetStatus tells its clients (metrics and health are made from it).
  virtual v1::StatusReply Status() const = 0;
  virtual EventLog& events() = 0;
  // What the support bundle holds of this daemon, collected when a client asks for it; without
  // secrets. Called on the client's thread.
  virtual void OnDiagnose(std::function<std::vector<DiagnosticFile>()> collect) = 0;
  // What the daemon cannot go on with (the simulator is gone): told to watchers and in the status;
  // no plan starts any more.
  virtual void ReportFault(std::string_view reason) = 0;
  // Ends all streams (UNAVAILABLE) and refuses new plans, so that the server can shut down.
  virtual void BeginShutdown() = 0;
};

}  // namespace mesorig::daemon
