#pragma once
// Internal to protocol/plan: what is really taken at each station, after what blocks and what the
// sample does not need is left out.

#include <cstdint>
#include <vector>

#include "protocol/plan/plan_source.h"

namespace mesorig {

struct LitStation {
  std::vector<double> axis_rad;
  // Per lamp of the set, ascending; those with no camera left are not there.
  struct Lit {
    int lamp = -1;
    std::vector<int> cameras;
  };
  std::vector<Lit> lit;
};

struct LitSet {
  // Of a grid all combinations, the last axis fastest; of a list as written. Stations may be empty.
  std::vector<LitStation> stations;
  uint32_t frames_blocked = 0, frames_unneeded = 0;
};

// InvalidArgument with the place in the file: a lamp or camera below the horizon of the reference
// plane, a set or a list's position where solids block everything.
StatusOr<LitSet> LightStations(const Rig& rig, const DirectionSet& set, const Needs& needs,
                               double h_ref_mm);

// Of these, those that no solid stands before.
std::vector<int> UnblockedCameras(const Rig& rig, const std::vector<int>& cameras,
                                  const std::vector<double>& axis_rad);
// Every combination of ascending angles, the last axis fastest.
std::vector<std::vector<double>> Combinations(const std::vector<std::vector<double>>& axis_rad);

}  // namespace mesorig
