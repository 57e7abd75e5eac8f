#pragma once
// Internal to protocol/plan: in which order stations and lamps are visited (docs/plans.md,
// "Order").

#include <span>
#include <vector>

#include "protocol/plan/stations.h"
#include "protocol/rig/rig.h"

namespace mesorig {

struct Visit {
  size_t station = 0;
  int lamp = -1;  // -1: of a sweep
};

// A grid's stations (as Combinations orders them) and lamps, to and fro in every dimension: what is
// dearest to change outermost, what is cheapest innermost; each axis begins at its end that is
// nearer to `at_rad`. Lamps that a station has not are passed over.
std::vector<Visit> OrderGrid(const Rig& rig, const std::vector<std::vector<double>>& axis_rad,
                             const std::vector<LitStation>& stations, std::span<const int> lamps,
                             double settle_s, std::span<const double> at_rad);
// The same without lamps: every station once.
std::vector<size_t> OrderStations(const Rig& rig, const std::vector<std::vector<double>>& axis_rad,
                                  double settle_s, std::span<const double> at_rad);

// From `at_rad` to the station that is nearest in time, and so on; all lamps of a station together,
// the one that shines already first.
std::vector<Visit> OrderList(const Rig& rig, const std::vector<LitStation>& stations,
                             double settle_s, std::span<const double> at_rad);

}  // namespace mesorig
