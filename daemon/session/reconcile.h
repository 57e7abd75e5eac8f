#pragma once
// Does the ledger balance? "No success without reconciliation" (DESIGN, "What must always hold").

#include <functional>
#include <string>
#include <vector>

#include "daemon/session/ledger.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// One way in which the ledger does not balance: how often, and the first of them.
struct Imbalance {
  std::string kind, first;
  uint32_t count = 0;
};

// Planned shots = triggers, frames = the sum of their cameras: for each shot and camera of the
// plan's steps (each frame of a sweep is a shot) exactly one row that no later one supersedes, of
// the rig's depth and of its size or the sweep's region, at its place in the sweep; sequence
// numbers without gaps; in one run no trigger and no frame of a camera shared by two shots, no
// exposure that ends before it begins; and `verify` of every such row (its pixels, read again from
// the segment, match their digest; of a released sweep, nothing more to verify). Empty: it
// balances. The plan has passed CheckPlan. Errors are those of reading the ledger.
StatusOr<std::vector<Imbalance>> FindImbalances(
    const CompiledPlan& plan, const Rig& rig, Ledger& ledger,
    const std::function<Status(const FrameRecord&)>& verify);

// DataLoss counts what does not balance and names the first of each kind.
Status Reconcile(const CompiledPlan& plan, const Rig& rig, Ledger& ledger,
                 const std::function<Status(const FrameRecord&)>& verify);

}  // namespace mesorig::daemon
