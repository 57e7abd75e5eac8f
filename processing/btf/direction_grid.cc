#include "processing/btf/direction_grid.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace mesorig::btf {
namespace {

constexpr double kMargin = 1e-7;        // rad: beyond every rounding of the tests that follow
constexpr double kWide = 80 * kPi / 180;  // caps beyond this radius hold whatever there is
constexpr size_t kCellsPerTriangle = 32, kLeastSide = 8, kMostSide = 512;

// The octahedron's point (x, y, 1 - |x| - |y|), its lower half folded outwards; x and y in [-1, 1].
Vec3 FromSquare(double x, double y) {
  const double z = 1 - std::abs(x) - std::abs(y);
  if (z >= 0) return Normalized({x, y, z});
  return Normalized({std::copysign(1 - std::abs(y), x), std::copysign(1 - std::abs(x), y), z});
}

// A cone around `centre` that holds a square of cells: its corners, and so all of it, since the edges
// of the octahedron cross a square from corner to corner or not at all.
struct Cap {
  Vec3 centre;
  double radius = kPi;
};
Cap CapOf(double x, double y, double size) {
  Cap cap{FromSquare(x + size / 2, y + size / 2), 0};
  for (const double dx : {0.0, size}) {
    for (const double dy : {0.0, size}) {
      cap.radius = std::max(cap.radius, AngleBetween(cap.centre, FromSquare(x + dx, y + dy)));
    }
  }
  cap.radius += kMargin;
  if (cap.radius > kWide) cap.radius = kPi;
  return cap;
}

}  // namespace

Arc::Arc(Vec3 a, Vec3 b) : a_(a), b_(b) {
  const Vec3 n = Cross(a, b);
  const double nn = Dot(n, n);
  dual_a_ = (1 / nn) * Cross(b, n);
  dual_b_ = (1 / nn) * Cross(n, a);
}

ArcPoint Arc::Nearest(Vec3 d) const {
  const double alpha = Dot(dual_a_, d), beta = Dot(dual_b_, d);
  if (alpha >= 0 && beta >= 0 && alpha + beta > 0) {
    const Vec3 q = Normalized(alpha * a_ + beta * b_);
    return {alpha / (alpha + beta), beta / (alpha + beta), Dot(q, d)};
  }
  const double to_a = Dot(a_, d), to_b = Dot(b_, d);
  return to_a >= to_b ? ArcPoint{1, 0, to_a} : ArcPoint{0, 1, to_b};
}

// Descends into quarters of the square, with what is left of the candidates.
struct DirectionGrid::Builder {
  const std::vector<std::array<Vec3, 3>>& inverse;
  const std::vector<Arc>& arcs;
  DirectionGrid& grid;

  bool MayHold(size_t triangle, const Cap& cap) const {
    const double least = -std::sin(cap.radius);
    return std::all_of(inverse[triangle].begin(), inverse[triangle].end(), [&](const Vec3& n) {
      return Dot(n, cap.centre) >= least * Norm(n);
    });
  }

  std::vector<int32_t> NearArcs(const std::vector<int32_t>& from, const Cap& cap) const {
    std::vector<double> angles;
    for (const int32_t i : from) {
      const double cosine = arcs[static_cast<size_t>(i)].Nearest(cap.centre).cosine;
      angles.push_back(std::acos(std::clamp(cosine, -1.0, 1.0)));
    }
    // acos loses half the digits near 1
    const double most = *std::min_element(angles.begin(), angles.end()) + 2 * cap.radius + 1e-6;
    std::vector<int32_t> near;
    for (size_t i = 0; i < from.size(); ++i) {
      if (angles[i] <= most) near.push_back(from[i]);
    }
    return near;
  }

  void Descend(size_t x, size_t y, size_t cells, const std::vector<int32_t>& of_triangles,
               const std::vector<int32_t>& of_arcs) {
    const double step = 2.0 / static_cast<double>(grid.side_);
    const Cap cap = CapOf(static_cast<double>(x) * step - 1, static_cast<double>(y) * step - 1,
                          static_cast<double>(cells) * step);
    std::vector<int32_t> triangles = of_triangles, near = of_arcs;
    if (cap.radius < kPi) {
      std::erase_if(triangles, [&](int32_t t) { return !MayHold(static_cast<size_t>(t), cap); });
      if (!near.empty()) near = NearArcs(of_arcs, cap);
    }
    if (cells > 1) {
      const size_t half = cells / 2;
      for (const size_t dy : {size_t{0}, half}) {
        for (const size_t dx : {size_t{0}, half}) Descend(x + dx, y + dy, half, triangles, near);
      }
      return;
    }
    Cell& cell = grid.cells_[y * grid.side_ + x];
    cell = {static_cast<uint32_t>(grid.lists_.size()), static_cast<uint16_t>(triangles.size()),
            static_cast<uint16_t>(near.size())};
    grid.lists_.insert(grid.lists_.end(), triangles.begin(), triangles.end());
    grid.lists_.insert(grid.lists_.end(), near.begin(), near.end());
  }
};

DirectionGrid DirectionGrid::Build(const std::vector<std::array<Vec3, 3>>& inverse,
                                   const std::vector<Arc>& arcs) {
  DirectionGrid grid;
  const auto wanted = static_cast<size_t>(
      std::sqrt(static_cast<double>(kCellsPerTriangle * (inverse.size() + arcs.size()))));
  grid.side_ = std::bit_ceil(std::clamp(wanted, kLeastSide, kMostSide));
  grid.cells_.resize(grid.side_ * grid.side_);
  std::vector<int32_t> all_triangles(inverse.size()), all_arcs(arcs.size());
  for (size_t i = 0; i < inverse.size(); ++i) all_triangles[i] = static_cast<int32_t>(i);
  for (size_t i = 0; i < arcs.size(); ++i) all_arcs[i] = static_cast<int32_t>(i);
  Builder{inverse, arcs, grid}.Descend(0, 0, grid.side_, all_triangles, all_arcs);
  return grid;
}

}  // namespace mesorig::btf
