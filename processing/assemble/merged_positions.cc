#include "processing/assemble/merged_positions.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace mesorig::assemble {
namespace {

constexpr double kRing = 2e-3;  // rad

struct Entry {
  Vec3 first, first_direction, sum;
  double count = 0;
  Vec3 direction;      // of the mean
  double ring = 0, azimuth = 0;
};

size_t FindOrAdd(Vec3 position, Vec3 direction, std::vector<Entry>& entries) {
  for (size_t k = 0; k < entries.size(); ++k) {
    if (Norm(position - entries[k].first) < kSamePosition &&
        AngleBetween(direction, entries[k].first_direction) < kSameDirection) {
      return k;
    }
  }
  entries.push_back({position, direction, {}, 0, {}, 0, 0});
  return entries.size() - 1;
}

}  // namespace

MergedPositions MergePositions(std::span<const Vec3> positions_mm, Vec3 centre_mm) {
  std::vector<Entry> entries;
  std::vector<size_t> entry_of;
  for (const Vec3& position : positions_mm) {
    const size_t k = FindOrAdd(position, Normalized(position - centre_mm), entries);
    entries[k].sum = entries[k].sum + position;
    entries[k].count += 1;
    entry_of.push_back(k);
  }
  for (Entry& entry : entries) {
    entry.direction = Normalized((1 / entry.count) * entry.sum - centre_mm);
    const Angles angles = AnglesFromDirection(entry.direction);
    entry.ring = std::round(angles.theta_rad / kRing);
    // 2 pi - rounding is azimuth zero.
    entry.azimuth = 2 * kPi - angles.phi_rad < kRing ? 0 : angles.phi_rad;
  }
  std::vector<size_t> order(entries.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    if (entries[a].ring != entries[b].ring) return entries[a].ring < entries[b].ring;
    return entries[a].azimuth < entries[b].azimuth;
  });
  MergedPositions merged;
  std::vector<int> rank(entries.size());
  for (const size_t k : order) {
    rank[k] = static_cast<int>(merged.positions_mm.size());
    merged.positions_mm.push_back((1 / entries[k].count) * entries[k].sum);
    merged.directions.push_back(entries[k].direction);
  }
  for (const size_t k : entry_of) merged.index_of.push_back(rank[k]);
  return merged;
}

}  // namespace mesorig::assemble
