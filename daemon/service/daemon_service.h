#pragma once
// The gRPC services of mesorigd, Control and Frames, over one sequencer and one state folder:
// sessions, the audit log, the lease's tokens.

#include <filesystem>
#include <memory>
#include <string_view>
#include <vector>

#include "daemon/control/manual_control.h"
#include "daemon/control/sequencer.h"
#include "daemon/service/audit_log.h"
#include "protocol/rig/rig.h"

namespace grpc {
class Service;
}

namespace mesorig::daemon {

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
  // What the daemon cannot go on with (the simulator is gone): told to watchers and in the status;
  // no plan starts any more.
  virtual void ReportFault(std::string_view reason) = 0;
  // Ends all streams (UNAVAILABLE) and refuses new plans, so that the server can shut down.
  virtual void BeginShutdown() = 0;
};

}  // namespace mesorig::daemon
