#pragma once
// A visit of the operator's hands to the rig: everything is off meanwhile, and what follows is the
// rig's own proof that the hands are out again (docs/laser.md, docs/running.md).

#include <string>

#include "daemon/control/rig_power.h"
#include "daemon/control/run_context.h"

namespace mesorig::daemon {

// Asks, with everything off already. `mount`: the laser's mount that is asked for, empty: none.
// Virtual time stands still while the operator is asked. Cancelled: somebody said stop, or a pause
// came before anybody was asked.
Status AskAtRest(const RunContext& context, std::string text, std::string mount);

// Takes the rig to rest, asks, and brings it up again.
Status VisitRig(const RunContext& context, RigPower& power, CameraArray& cameras, std::string text,
                std::string mount);

}  // namespace mesorig::daemon
