#pragma once
// Internal to spherical_interpolation: which triangles, and which edges of the rim, come into
// question for a direction. An octahedral map of the sphere in square cells (Cigolle et al. 2014);
// a look-up costs one division, whatever the number of directions.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "protocol/base/geometry.h"

namespace mesorig::btf {

// The arc from a to b: the point of it that is nearest to d, as weights of a and b that sum to one,
// and its cosine to d.
struct ArcPoint {
  double weight_a = 1, weight_b = 0, cosine = -2;
};
class Arc {
 public:
  // Unit vectors, neither equal nor opposite.
  Arc(Vec3 a, Vec3 b);
  ArcPoint Nearest(Vec3 d) const;

 private:
  Vec3 a_, b_, dual_a_, dual_b_;  // d = (dual_a . d) a + (dual_b . d) b + what is normal to both
};

// Immutable after Build; look-ups are reentrant.
class DirectionGrid {
 public:
  // `inverse`: the dual bases of the triangles.
  static DirectionGrid Build(const std::vector<std::array<Vec3, 3>>& inverse,
                             const std::vector<Arc>& arcs);
  // Ascending indices; every triangle that holds d is among them. d is not zero, and finite.
  std::span<const int32_t> Triangles(Vec3 d) const {
    const Cell& cell = cells_[CellOf(d)];
    return {lists_.data() + cell.first, cell.triangles};
  }
  // The arc that is nearest to d is among these.
  std::span<const int32_t> Arcs(Vec3 d) const {
    const Cell& cell = cells_[CellOf(d)];
    return {lists_.data() + cell.first + cell.triangles, cell.arcs};
  }

 private:
  struct Cell {
    uint32_t first = 0;  // of its triangles in lists_, its arcs behind them
    uint16_t triangles = 0, arcs = 0;
  };
  struct Builder;
  size_t CellOf(Vec3 d) const {
    const double scale = 1 / (std::abs(d.x) + std::abs(d.y) + std::abs(d.z));
    double x = d.x * scale, y = d.y * scale;
    if (d.z < 0) {
      const double folded = std::copysign(1 - std::abs(y), x);
      y = std::copysign(1 - std::abs(x), y);
      x = folded;
    }
    return Place(y) * side_ + Place(x);
  }
  size_t Place(double t) const {
    const auto side = static_cast<double>(side_);
    return static_cast<size_t>(std::clamp((t + 1) / 2 * side, 0.0, side - 1));
  }

  size_t side_ = 0;  // cells; a power of two
  std::vector<Cell> cells_;
  std::vector<int32_t> lists_;
};

}  // namespace mesorig::btf
