#pragma once
// mesorig-processd without its command line: a client of mesorigd that turns sessions into files,
// and the Processing service that tells about them.

#include <filesystem>
#include <memory>

#include "protocol/base/status.h"

namespace mesorig::service {

struct ServerOptions {
  std::filesystem::path runtime_dir;   // where mesorigd publishes itself, and this service too
  std::filesystem::path products_dir;  // created if need be
  double connect_timeout_s = 30;       // for mesorigd to be there at the start
  double patience_s = 30;              // for it to come back during a session
};

class ProcessingServer {
 public:
  // Claims the name and listens. FailedPrecondition when another one runs, InvalidArgument for
  // folders that cannot be used.
  static StatusOr<std::unique_ptr<ProcessingServer>> Start(const ServerOptions& options);
  virtual ~ProcessingServer() = default;
  // Follows the daemon's sessions until Stop: takes up the running one, those that the daemon
  // still tells of and that have no product yet, and each that starts. Unavailable when mesorigd
  // is not there in time, FailedPrecondition when it speaks another version. When it goes away
  // later, waits for it.
  virtual Status Run() = 0;
  // Ends Run, every call and all work; what was not packed is gone. Any thread, any number of
  // times.
  virtual void Stop() = 0;
};

}  // namespace mesorig::service
