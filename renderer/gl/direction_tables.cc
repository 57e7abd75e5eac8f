#include "renderer/gl/direction_tables.h"

#include <algorithm>
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
                                    Dot(d, Cross(at(a), at(b)))}) /
                          volume;
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
  const auto at = [&](int i) { return set.directions()[static_cast<size_t>(i)]; };
  const auto row = [](Vec3 v, double w) -> std::array<float, 4> {
    return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z),
            static_cast<float>(w)};
  };
  const std::vector<Edge> edges = HullOf(set);
  const size_t first_edge = rows.size(), first_triangle = first_edge + 3 * edges.size();
  const auto edge_row = [&](int e) { return static_cast<double>(first_edge) + 3 * e; };
  const auto triangle_row = [&](int t) { return static_cast<double>(first_triangle) + 4 * t; };

  std::map<int, int> begins, ends;  // hull edge by its first and by its second corner
  std::map<Edge, double> beyond;    // the record to the left of a directed edge
  for (int e = 0; e < static_cast<int>(edges.size()); ++e) {
    const auto [a, b] = edges[static_cast<size_t>(e)];
    begins[a] = e;
    ends[b] = e;
    beyond[{b, a}] = -1 - edge_row(e);
  }
  for (int e = 0; e < static_cast<int>(edges.size()); ++e) {
    const auto [a, b] = edges[static_cast<size_t>(e)];
    const auto next = begins.find(b), previous = ends.find(a);
    rows.push_back(row(at(a), a));
    rows.push_back(row(at(b), b));
    rows.push_back(row({edge_row(next == begins.end() ? e : next->second),
                        edge_row(previous == ends.end() ? e : previous->second), 0},
                       0));
  }
  for (int t = 0; t < static_cast<int>(set.triangles().size()); ++t) {
    const auto& [a, b, c] = set.triangles()[static_cast<size_t>(t)];
    for (const Edge edge : {Edge{a, b}, Edge{b, c}, Edge{c, a}}) beyond[edge] = triangle_row(t);
  }
  for (const auto& [a, b, c] : set.triangles()) {
    const double scale = 1 / Dot(at(a), Cross(at(b), at(c)));
    rows.push_back(row(scale * Cross(at(b), at(c)), a));
    rows.push_back(row(scale * Cross(at(c), at(a)), b));
    rows.push_back(row(scale * Cross(at(a), at(b)), c));
    rows.push_back(row({beyond.at({c, b}), beyond.at({a, c}), beyond.at({b, a})}, 0));
  }
  for (int j = 0; j < kMapSize; ++j) {
    for (int i = 0; i < kMapSize; ++i) {
      map.push_back(static_cast<float>(
          set.triangles().empty() ? -1 - edge_row(0)
                                  : triangle_row(StartTriangle(set, MapCellDirection(i, j)))));
    }
  }
}

}  // namespace mesorig::renderer
