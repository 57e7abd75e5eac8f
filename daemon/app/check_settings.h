#pragma once
// `mesorigd --check-config`: would it start?

#include "daemon/app/settings.h"

namespace mesorig::daemon {

// Reads the rig file, tries the folders, the ports and the programs that notifications run; prints
// to stdout what would be used, and what is in use by a daemon that runs. Changes nothing that
// stays. InvalidArgument: all that is wrong, a line each.
Status CheckSettings(const Settings& settings);

}  // namespace mesorig::daemon
