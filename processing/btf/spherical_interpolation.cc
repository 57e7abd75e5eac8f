#include "processing/btf/spherical_interpolation.h"

#include <algorithm>
#include <set>

#include "processing/btf/spherical_hull.h"

namespace mesorig::btf {
namespace {

constexpr double kSame = 5e-5;     // rad: directions that coincide
constexpr double kShortest = 1e-150, kLongest = 1e150;  // beyond, squares are no numbers
constexpr double kInside = -1e-9;  // weight of a point that lies on an edge up to rounding

bool IsFinite(Vec3 d) { return std::isfinite(d.x) && std::isfinite(d.y) && std::isfinite(d.z); }

DirectionWeights Only(int index) { return {{index, 0, 0}, {1.0f, 0.0f, 0.0f}}; }

// The first of every group of directions that coincide.
std::vector<int> UniqueOnes(const std::vector<Vec3>& directions) {
  std::vector<int> unique;
  for (size_t i = 0; i < directions.size(); ++i) {
    const bool seen = std::any_of(unique.begin(), unique.end(), [&](int u) {
      return Norm(directions[static_cast<size_t>(u)] - directions[i]) < kSame;
    });
    if (!seen) unique.push_back(static_cast<int>(i));
  }
  return unique;
}

// Edges that belong to one triangle only: the rim of the measured cone.
std::vector<std::array<int, 2>> Rim(const std::vector<std::array<int, 3>>& triangles) {
  std::set<std::array<int, 2>> edges;
  for (const auto& t : triangles) {
    for (size_t k = 0; k < 3; ++k) edges.insert({t[k], t[(k + 1) % 3]});
  }
  std::vector<std::array<int, 2>> rim;
  for (const auto& edge : edges) {
    if (!edges.contains({edge[1], edge[0]})) rim.push_back(edge);
  }
  return rim;
}

// Neighbours along the one great circle that holds all of `which` (at least two). The widest gap
// stays open unless every gap is less than half the circle.
std::vector<std::array<int, 2>> Chain(const std::vector<Vec3>& directions,
                                      const std::vector<int>& which) {
  const Vec3 x = directions[static_cast<size_t>(which[0])];
  Vec3 normal;
  for (int i : which) {
    const Vec3 n = Cross(x, directions[static_cast<size_t>(i)]);
    if (Norm(n) > Norm(normal)) normal = n;
  }
  const Vec3 y = Cross(Normalized(normal), x);
  std::vector<std::pair<double, int>> order;
  for (int i : which) {
    const Vec3 d = directions[static_cast<size_t>(i)];
    order.emplace_back(std::atan2(Dot(d, y), Dot(d, x)), i);
  }
  std::sort(order.begin(), order.end());
  std::vector<std::array<int, 2>> edges;
  for (size_t i = 0; i < order.size(); ++i) {
    const auto& next = order[(i + 1) % order.size()];
    double gap = next.first - order[i].first;
    if (i + 1 == order.size()) gap += 2 * kPi;
    if (gap < kPi - kSame) edges.push_back({order[i].second, next.second});
  }
  return edges;
}

std::array<Vec3, 3> DualBasis(Vec3 a, Vec3 b, Vec3 c) {
  const double determinant = Dot(a, Cross(b, c));
  return {(1 / determinant) * Cross(b, c), (1 / determinant) * Cross(c, a),
          (1 / determinant) * Cross(a, b)};
}

DirectionWeights Normal(const std::array<int, 3>& index, std::array<double, 3> w) {
  for (double& x : w) x = std::max(x, 0.0);
  const double scale = 1 / (w[0] + w[1] + w[2]);
  DirectionWeights result;
  for (size_t k = 0; k < 3; ++k) {
    result.weight[k] = static_cast<float>(w[k] * scale);
    result.index[k] = result.weight[k] > 0 ? index[k] : 0;
  }
  return result;
}

}  // namespace

StatusOr<DirectionInterpolator> DirectionInterpolator::Build(const std::vector<Vec3>& directions) {
  if (directions.empty()) return InvalidArgument("no directions to interpolate between");
  DirectionInterpolator result;
  for (size_t i = 0; i < directions.size(); ++i) {
    const Vec3 d = directions[i];
    if (!IsFinite(d) || !(Norm(d) > 0) || !std::isfinite(Norm(d))) {
      return InvalidArgument("direction {} = ({}, {}, {}) is zero or not finite", i, d.x, d.y, d.z);
    }
    result.directions_.push_back(Normalized(d));
    if (result.directions_[i].z > result.directions_[static_cast<size_t>(result.zenith_)].z) {
      result.zenith_ = static_cast<int>(i);
    }
  }
  const std::vector<int> unique = UniqueOnes(result.directions_);
  std::vector<Vec3> points;
  for (int u : unique) points.push_back(result.directions_[static_cast<size_t>(u)]);
  result.triangles_ = TriangulateSphere(points);
  for (auto& t : result.triangles_) {
    result.inverse_.push_back(DualBasis(points[static_cast<size_t>(t[0])],
                                        points[static_cast<size_t>(t[1])],
                                        points[static_cast<size_t>(t[2])]));
    for (int& k : t) k = unique[static_cast<size_t>(k)];
  }
  if (!result.triangles_.empty()) {
    result.hull_ = Rim(result.triangles_);
  } else if (unique.size() > 1) {
    result.hull_ = Chain(result.directions_, unique);
  }
  for (const auto& [a, b] : result.hull_) {
    result.arcs_.emplace_back(result.directions_[static_cast<size_t>(a)],
                              result.directions_[static_cast<size_t>(b)]);
  }
  result.grid_ = DirectionGrid::Build(result.inverse_, result.arcs_);
  return result;
}

DirectionWeights DirectionInterpolator::Lookup(Vec3 d, bool& inside) const {
  const double size = std::abs(d.x) + std::abs(d.y) + std::abs(d.z);  // 1 to sqrt(3) times the norm
  inside = false;
  if (!(size > kShortest && size < kLongest)) return Only(zenith_);
  d = (1 / size) * d;
  for (const int32_t i : grid_.Triangles(d)) {
    const auto t = static_cast<size_t>(i);
    const std::array<double, 3> w = {Dot(inverse_[t][0], d), Dot(inverse_[t][1], d),
                                     Dot(inverse_[t][2], d)};
    if (std::min({w[0], w[1], w[2]}) >= kInside) {
      inside = true;
      return Normal(triangles_[t], w);
    }
  }
  return OnRim(Normalized(d));
}

// On the sphere the nearest point of a closed convex region lies on its rim.
DirectionWeights DirectionInterpolator::OnRim(Vec3 d) const {
  ArcPoint best;
  std::array<int, 3> index{};
  for (const int32_t i : grid_.Arcs(d)) {
    const auto& [a, b] = hull_[static_cast<size_t>(i)];
    const ArcPoint point = arcs_[static_cast<size_t>(i)].Nearest(d);
    if (point.cosine > best.cosine) best = point, index = {a, b, 0};
  }
  if (best.cosine > -2) return Normal(index, {best.weight_a, best.weight_b, 0});
  int nearest = 0;  // one direction, or two opposite ones
  for (size_t i = 1; i < directions_.size(); ++i) {
    if (Dot(directions_[i], d) > Dot(directions_[static_cast<size_t>(nearest)], d)) {
      nearest = static_cast<int>(i);
    }
  }
  return Only(nearest);
}

bool DirectionInterpolator::Inside(Vec3 d) const {
  const double length = Norm(d);
  if (!(length > 0) || !std::isfinite(length)) return false;
  const DirectionWeights chosen = Lookup(d);
  Vec3 sum;
  for (size_t k = 0; k < 3; ++k) {
    sum = sum + chosen.weight[k] * directions_[static_cast<size_t>(chosen.index[k])];
  }
  return AngleBetween(Normalized(sum), (1 / length) * d) < 1e-6;
}

double HorizonScale(const DirectionInterpolator& lights, const DirectionWeights& chosen, Vec3 l) {
  const double length = Norm(l);
  if (!(length > 0) || !std::isfinite(length) || l.z <= 0) return 0;
  Vec3 sum;
  for (size_t k = 0; k < 3; ++k) {
    sum = sum + chosen.weight[k] * lights.directions()[static_cast<size_t>(chosen.index[k])];
  }
  const double cos_nearest = Normalized(sum).z, cos_light = l.z / length;
  if (cos_light >= kMaxHorizonScale * cos_nearest) return kMaxHorizonScale;
  return cos_light / cos_nearest;
}

}  // namespace mesorig::btf
