#pragma once
// mesorigd from its options to its end.

#include <string>

#include "daemon/service/access.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

struct ServeOptions {
  std::string rig;          // rig file
  std::string state_dir;    // sessions live below it
  std::string runtime_dir;  // where programs find each other
  AccessOptions access;     // who may call
};

// Claims the endpoint, connects the rig and serves until SIGTERM or SIGINT: then a running plan is
// stopped (lamps off), its frames are flushed and the services end, all within a few seconds.
// When the simulator dies it goes on serving its status (fault) and sessions, starts no plan any
// more, and returns that error when it is told to end. Call on the main thread before any other
// thread exists: it blocks the signals.
Status Serve(const ServeOptions& options);

}  // namespace mesorig::daemon
