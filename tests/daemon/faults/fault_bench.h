#pragma once
// One session under injected faults: the simulator's devices in this process with a cheap image
// source, the real drivers, the real sequencer, a real session on disk; virtual time.

#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/sim_wire/sim_server.h"

namespace mesorig::daemon {

using FaultScript = std::vector<sim_wire::TimedInjection>;
// Digest of a live frame's pixels by camera and shot.
using LiveDigests = std::map<std::pair<int, uint32_t>, std::string>;

struct FaultOutcome {
  bool complete = false;
  std::string reason;  // when it is not
  int recoveries = 0;
  double virtual_s = 0;
  LiveDigests live;      // read again from the disk
  std::string damage;    // what was acknowledged and is not there and whole; empty: nothing
  std::string still_on;  // by the simulator's own state; empty: nothing
};

enum class FaultedPlan { kLamps, kSweeps };  // SmallPlan; SmallLaserPlan, with an operator

// Runs the small plan of the small rig to its end, whatever that is. `root`: where sessions go.
FaultOutcome RunUnderFaults(const std::filesystem::path& root, FaultScript script,
                            FaultedPlan plan = FaultedPlan::kLamps);

}  // namespace mesorig::daemon
