#pragma once
// Internal to protocol/plan: which pairs of view and light a sample needs, by what its record says
// of it. A sample that looks the same after a turn needs a pair only once of all that are the same
// pair turned; beyond max_theta_rad it needs none.

#include <array>
#include <set>

#include "protocol/plan/plan_source.h"

namespace mesorig {

class NeededPairs {
 public:
  explicit NeededPairs(const Needs& needs) : needs_(needs) {}
  // Unit directions in the sample frame. True for the first of each class of equal pairs.
  bool Take(Vec3 view, Vec3 light);
  bool WithinTheta(Vec3 direction) const;

 private:
  // Directions that differ by less than a thousandth are one.
  using Key = std::array<int, 6>;
  Key Canonical(Vec3 view, Vec3 light) const;

  const Needs needs_;
  std::set<Key> taken_;
};

}  // namespace mesorig
