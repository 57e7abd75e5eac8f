#pragma once
// Does the ledger balance? "No success without reconciliation" (DESIGN, "What must always hold").

#include <functional>

#include "daemon/session/ledger.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// Planned shots = triggers, frames = the sum of their cameras: for each shot and camera of the
// plan's steps (each frame of a sweep is a shot) exactly one row that no later one supersedes, of
// the rig's depth and of its size or the sweep's region, at its place in the sweep; sequence
// numbers without gaps; no trigger shared by two shots; and `verify` of every such row (its pixels,
// read again from the segment, match their digest; of a released sweep, nothing more to verify).
// The plan has passed CheckPlan.
// DataLoss counts what does not balance and names the first of each kind.
Status Reconcile(const CompiledPlan& plan, const Rig& rig, Ledger& ledger,
                 const std::function<Status(const FrameRecord&)>& verify);

}  // namespace mesorig::daemon
