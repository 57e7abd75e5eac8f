#pragma once
// mesorigd from its settings to its end.

#include <functional>

#include "daemon/app/settings.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// Claims the state folder and the endpoint, connects the rig and serves until SIGTERM or SIGINT: then
// a running plan is stopped (lamps off), its frames are flushed and the services end, all within a
// few seconds. When the simulator dies it goes on serving its status (fault) and sessions, starts no
// plan any more, and returns that error when it is told to end. SIGHUP: `reread` gives the settings
// anew; what can change while it runs is taken up, the rest is named in the log. systemd is told what
// happens ($NOTIFY_SOCKET) and its watchdog is fed while the daemon makes progress.
// Call on the main thread before any other thread exists: it blocks the signals.
Status Serve(const Settings& settings, const std::function<StatusOr<Settings>()>& reread);

}  // namespace mesorig::daemon
