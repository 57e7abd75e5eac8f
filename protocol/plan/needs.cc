#include "protocol/plan/needs.h"

#include <cmath>

namespace mesorig {
namespace {

constexpr double kSame = 1e-3;
// Directions of regular grids fall on round numbers: cells are laid so that these are inside.
constexpr double kOffset = 0.3819660113;

int Cell(double value) { return static_cast<int>(std::floor(value / kSame + kOffset)); }

Vec3 Turned(Vec3 v, double cosine, double sine) {
  return {cosine * v.x - sine * v.y, sine * v.x + cosine * v.y, v.z};
}

}  // namespace

bool NeededPairs::WithinTheta(Vec3 direction) const {
  if (needs_.max_theta_rad == 0) return true;
  return std::atan2(std::hypot(direction.x, direction.y), direction.z) <=
         needs_.max_theta_rad + 1e-9;
}

NeededPairs::Key NeededPairs::Canonical(Vec3 view, Vec3 light) const {
  if (needs_.symmetry == Symmetry::kIsotropic) {
    // What a turn about the normal leaves as it is.
    const double along = view.x * light.x + view.y * light.y;
    const double across = view.x * light.y - view.y * light.x;
    return {Cell(view.z), Cell(light.z), Cell(along), Cell(across), 0, 0};
  }
  // The least of the keys of all turned pairs.
  const int turns = needs_.symmetry == Symmetry::kQuarterTurn ? 4 : 2;
  Key least{};
  for (int i = 0; i < turns; ++i) {
    const double angle = 2 * kPi * i / turns;
    const double cosine = std::round(std::cos(angle)), sine = std::round(std::sin(angle));
    const Vec3 v = Turned(view, cosine, sine), l = Turned(light, cosine, sine);
    const Key key{Cell(v.x), Cell(v.y), Cell(v.z), Cell(l.x), Cell(l.y), Cell(l.z)};
    if (i == 0 || key < least) least = key;
  }
  return least;
}

bool NeededPairs::Take(Vec3 view, Vec3 light) {
  if (!WithinTheta(view) || !WithinTheta(light)) return false;
  if (needs_.symmetry == Symmetry::kNone) return true;
  return taken_.insert(Canonical(view, light)).second;
}

}  // namespace mesorig
