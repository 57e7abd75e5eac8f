#include "protocol/plan/order.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>

#include "protocol/plan/timing.h"

namespace mesorig {
namespace {

// One thing that a grid varies: an axis, or the lamps.
struct Dimension {
  size_t count = 1;
  double step_s = 0;  // what a step of it takes, on the average
  bool backwards = false;
};

Dimension AxisDimension(const Axis& axis, const std::vector<double>& angles, double settle_s,
                        double at_rad) {
  Dimension dimension{angles.size(), 0, false};
  for (size_t i = 1; i < angles.size(); ++i) {
    dimension.step_s += MoveSeconds(axis, angles[i] - angles[i - 1]);
  }
  dimension.step_s /= std::max(1.0, static_cast<double>(angles.size()) - 1);
  dimension.step_s += std::max(settle_s, axis.settle_s);
  dimension.backwards = std::abs(angles.back() - at_rad) < std::abs(angles.front() - at_rad);
  return dimension;
}

// Visits every combination of indices, dearest dimension outermost, each to and fro.
void WalkToAndFro(const std::vector<Dimension>& dimensions,
                  const std::function<void(std::span<const size_t>)>& visit) {
  std::vector<size_t> outermost_first(dimensions.size());
  std::iota(outermost_first.begin(), outermost_first.end(), size_t{0});
  std::stable_sort(outermost_first.begin(), outermost_first.end(),
                   [&](size_t a, size_t b) { return dimensions[a].step_s > dimensions[b].step_s; });
  std::vector<size_t> index(dimensions.size(), 0);
  std::vector<int> direction(dimensions.size(), 1);
  for (size_t i = 0; i < dimensions.size(); ++i) {
    if (!dimensions[i].backwards) continue;
    index[i] = dimensions[i].count - 1;
    direction[i] = -1;
  }
  for (;;) {
    visit(index);
    size_t turn = dimensions.size();
    while (turn > 0) {
      const size_t i = outermost_first[turn - 1];
      const bool at_end = direction[i] > 0 ? index[i] + 1 == dimensions[i].count : index[i] == 0;
      if (!at_end) {
        index[i] = direction[i] > 0 ? index[i] + 1 : index[i] - 1;
        break;
      }
      direction[i] = -direction[i];
      --turn;
    }
    if (turn == 0) return;
  }
}

// Of Combinations: the last axis fastest.
size_t StationIndex(std::span<const size_t> index, const std::vector<Dimension>& dimensions,
                    size_t axes) {
  size_t station = 0;
  for (size_t i = 0; i < axes; ++i) station = station * dimensions[i].count + index[i];
  return station;
}

std::vector<Dimension> AxisDimensions(const Rig& rig,
                                      const std::vector<std::vector<double>>& axis_rad,
                                      double settle_s, std::span<const double> at_rad) {
  std::vector<Dimension> dimensions;
  for (size_t i = 0; i < axis_rad.size(); ++i) {
    dimensions.push_back(AxisDimension(rig.axes[i], axis_rad[i], settle_s, at_rad[i]));
  }
  return dimensions;
}

bool HasLamp(const LitStation& station, int lamp) {
  return std::any_of(station.lit.begin(), station.lit.end(),
                     [&](const LitStation::Lit& lit) { return lit.lamp == lamp; });
}

}  // namespace

std::vector<Visit> OrderGrid(const Rig& rig, const std::vector<std::vector<double>>& axis_rad,
                             const std::vector<LitStation>& stations, std::span<const int> lamps,
                             double settle_s, std::span<const double> at_rad) {
  const size_t axes = axis_rad.size();
  std::vector<Dimension> dimensions = AxisDimensions(rig, axis_rad, settle_s, at_rad);
  dimensions.push_back({lamps.size(), LampSeconds(rig), false});
  std::vector<Visit> visits;
  WalkToAndFro(dimensions, [&](std::span<const size_t> index) {
    const size_t station = StationIndex(index, dimensions, axes);
    const int lamp = lamps[index[axes]];
    if (HasLamp(stations[station], lamp)) visits.push_back({station, lamp});
  });
  return visits;
}

std::vector<size_t> OrderStations(const Rig& rig, const std::vector<std::vector<double>>& axis_rad,
                                  double settle_s, std::span<const double> at_rad) {
  const std::vector<Dimension> dimensions = AxisDimensions(rig, axis_rad, settle_s, at_rad);
  std::vector<size_t> order;
  WalkToAndFro(dimensions, [&](std::span<const size_t> index) {
    order.push_back(StationIndex(index, dimensions, axis_rad.size()));
  });
  return order;
}

std::vector<Visit> OrderList(const Rig& rig, const std::vector<LitStation>& stations,
                             double settle_s, std::span<const double> at_rad) {
  std::vector<size_t> left(stations.size());
  std::iota(left.begin(), left.end(), size_t{0});
  std::vector<Visit> visits;
  std::vector<double> at(at_rad.begin(), at_rad.end());
  int shining = -1;
  while (!left.empty()) {
    // Of equal ones that where the other axes move least.
    const auto seconds_to = [&](size_t s) {
      double sum = 0;
      for (size_t i = 0; i < at.size(); ++i) {
        sum += MoveSeconds(rig.axes[i], stations[s].axis_rad[i] - at[i]);
      }
      return std::pair(PositioningSeconds(rig, at, stations[s].axis_rad, settle_s), sum);
    };
    auto nearest = left.begin();
    auto least = seconds_to(*nearest);
    for (auto it = left.begin() + 1; it != left.end() && least.second > 0; ++it) {
      const auto seconds = seconds_to(*it);
      if (seconds < least) least = seconds, nearest = it;
    }
    const size_t station = *nearest;
    left.erase(nearest);
    std::vector<int> lamps;
    for (const LitStation::Lit& lit : stations[station].lit) lamps.push_back(lit.lamp);
    if (lamps.empty()) continue;
    const auto lit = std::find(lamps.begin(), lamps.end(), shining);
    if (lit != lamps.end()) std::rotate(lamps.begin(), lit, lit + 1);
    for (const int lamp : lamps) visits.push_back({station, lamp});
    shining = lamps.back();
    at = stations[station].axis_rad;
  }
  return visits;
}

}  // namespace mesorig
