#include "renderer/gl/direction_tables.h"

#include <cmath>
#include <map>

namespace mesorig::renderer {
namespace {

using Edge = std::array<int, 2>;

// The triangle whose smallest barycentric weight of d is largest: the one that holds d, or for a
// direction beyond all of them one that is near.
int StartTriangle(const btf::DirectionInterpolator& set, Vec3 d) {
  const auto at = [&](int i) { return set.directions()[static_cast<size_t>(i)]; };
  int best = 0;
  double best_weight = -1e300;
  for (size_t t = 0; t < set.triangles().size(); ++t) {
    const auto& [a, b, c] = set.triangles()[t];
    const double volume = Dot(at(a), Cross(at(b), at(c)));
    const double weight = std::min({Dot(d, Cross(at(b), at(c))), Dot(d, Cross(at(c), at(a))),
                                    Dot(d, Cross(at(a), at(b)))}) / volume;
    if (weight > best_weight) best_weight = weight, best = static_cast<int>(t);
  }
  return best;
}

// Edge {a, a}: a single direction.
std::vector<Edge> HullOf(const btf::DirectionInterpolator& set) {
  if (!set.hull().empty()) return set.hull();
  return {{0, 0}};
}

}  // namespace

Vec3 MapCellDirection(int i, int j) {
  const double u = (i + 0.5) / DirectionTables::kMapSize * 2 - 1;
  const double v = (j + 0.5) / DirectionTables::kMapSize * 2 - 1;
  const double x = (u + v) / 2, y = (u - v) / 2;
  return Normalized({x, y, 1 - std::abs(x) - std::abs(y)});
}

void DirectionTables::Append(const btf::DirectionInterpolator& set) {
  const auto first_direction = static_cast<int32_t>(directions.size());
  const auto first_triangle = static_cast<int32_t>(triangles.size() / 2);
  const auto first_edge = static_cast<int32_t>(hull.size());
  for (const Vec3 d : set.directions()) {
    directions.push_back(
        {static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z), 0});
  }
  const std::vector<Edge> edges = HullOf(set);
  std::map<int, int> begins, ends;         // hull edge by its first and by its second corner
  std::map<Edge, int32_t> beyond;          // what lies to the left of a directed edge
  for (size_t e = 0; e < edges.size(); ++e) {
    begins[edges[e][0]] = static_cast<int>(e);
    ends[edges[e][1]] = static_cast<int>(e);
    beyond[{edges[e][1], edges[e][0]}] = -1 - (first_edge + static_cast<int32_t>(e));
  }
  for (size_t e = 0; e < edges.size(); ++e) {
    const auto [a, b] = edges[e];
    const auto next = begins.find(b), previous = ends.find(a);
    const auto self = static_cast<int>(e);
    hull.push_back({first_direction + a, first_direction + b,
                    first_edge + (next == begins.end() ? self : next->second),
                    first_edge + (previous == ends.end() ? self : previous->second)});
  }
  for (size_t t = 0; t < set.triangles().size(); ++t) {
    const auto& [a, b, c] = set.triangles()[t];
    for (const Edge edge : {Edge{a, b}, Edge{b, c}, Edge{c, a}}) {
      beyond[edge] = first_triangle + static_cast<int32_t>(t);
    }
  }
  for (const auto& [a, b, c] : set.triangles()) {
    triangles.push_back({first_direction + a, first_direction + b, first_direction + c, 0});
    triangles.push_back({beyond.at({c, b}), beyond.at({a, c}), beyond.at({b, a}), 0});
  }
  for (int j = 0; j < kMapSize; ++j) {
    for (int i = 0; i < kMapSize; ++i) {
      map.push_back(set.triangles().empty() ? -1 - first_edge
                                            : first_triangle + StartTriangle(set, MapCellDirection(i, j)));
    }
  }
}

}  // namespace mesorig::renderer
