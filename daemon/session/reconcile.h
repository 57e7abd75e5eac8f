#pragma once
// Does the ledger balance? "No success without reconciliation" (DESIGN, "What must always hold").

#include <functional>

#include "daemon/session/ledger.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// Planned shots = triggers, frames = the sum of their cameras: for each shot and camera of the
// plan's steps exactly one row that no later one supersedes, of the rig's size and depth; sequence
// numbers without gaps; no trigger shared by two shots; and `verify` of every such row (its pixels,
// read again from the segment, match their digest).
// DataLoss counts what does not balance and names the first of each kind.
Status Reconcile(const CompiledPlan& plan, const Rig& rig, Ledger& ledger,
                 const std::function<Status(const FrameRecord&)>& verify);

}  // namespace mesorig::daemon
