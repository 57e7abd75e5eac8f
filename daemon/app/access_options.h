#pragma once
// mesorigd's options about who may call.

#include <CLI/CLI.hpp>

#include "daemon/service/access.h"

namespace mesorig::daemon {

// --listen, --tls-dir, --group ROLE=GROUP, --max-certificate-days. `options` lives as long as
// `app`.
void AddAccessOptions(CLI::App& app, AccessOptions& options);

}  // namespace mesorig::daemon
