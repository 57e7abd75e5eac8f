#pragma once
// The gRPC services of mesorigd, Control and Frames, over one sequencer and one folder of sessions.

#include <filesystem>
#include <memory>
#include <string_view>
#include <vector>

#include "daemon/control/sequencer.h"
#include "protocol/rig/rig.h"

namespace grpc {
class Service;
}

namespace mesorig::daemon {

// Thread-safe. Outlives the grpc::Server that serves it.
class DaemonService {
 public:
  // Borrows rig and sequencer, which outlive it; takes the sequencer's event listener. Sessions are
  // created in and read from `sessions_root`.
  static std::unique_ptr<DaemonService> Create(const Rig& rig, Sequencer& sequencer,
                                               std::filesystem::path sessions_root);
  virtual ~DaemonService() = default;

  virtual std::vector<grpc::Service*> services() = 0;
  // What the daemon cannot go on with (the simulator is gone): told to watchers and in the status;
  // no plan starts any more.
  virtual void ReportFault(std::string_view reason) = 0;
  // Ends all streams (UNAVAILABLE) and refuses new plans, so that the server can shut down.
  virtual void BeginShutdown() = 0;
};

}  // namespace mesorig::daemon
