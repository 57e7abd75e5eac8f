#include "processing/btf/spherical_hull.h"

#include <algorithm>
#include <cstdint>

namespace mesorig::btf {
namespace {

constexpr double kJitter = 1e-11;
constexpr double kSliver = 1e-6;  // rad

struct Face {
  std::array<int, 3> at;  // counter-clockwise seen from outside
  bool alive = true;
};

// A fixed pseudo-random number in [-1, 1] (splitmix64).
double Noise(uint64_t key) {
  uint64_t x = (key + 1) * 0x9E3779B97F4A7C15u;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
  x ^= x >> 31;
  return static_cast<double>(x >> 11) * 0x1p-52 - 1.0;
}

// Six times the signed volume; positive when p lies outside (in front of) face abc.
double Outside(const std::vector<Vec3>& p, const Face& face, int point) {
  const Vec3 a = p[static_cast<size_t>(face.at[0])];
  return Dot(Cross(p[static_cast<size_t>(face.at[1])] - a, p[static_cast<size_t>(face.at[2])] - a),
             p[static_cast<size_t>(point)] - a);
}

// The height of a spherical triangle over its longest side, rad (small triangles).
double Height(Vec3 a, Vec3 b, Vec3 c) {
  const double longest = std::max({Norm(Cross(a, b)), Norm(Cross(b, c)), Norm(Cross(c, a))});
  return longest > 0 ? Dot(a, Cross(b, c)) / longest : 0;
}

// Points 1.. are the directions, 0 is the origin. Three directions that span a volume with it.
bool FindSimplex(const std::vector<Vec3>& p, std::array<int, 3>& simplex) {
  const int n = static_cast<int>(p.size());
  int best_b = -1, best_c = -1;
  double best = 0;
  for (int b = 2; b < n; ++b) {
    const double area = Norm(Cross(p[1], p[static_cast<size_t>(b)]));
    if (area > best) best = area, best_b = b;
  }
  if (best_b < 0) return false;
  const Vec3 normal = Cross(p[1], p[static_cast<size_t>(best_b)]);
  best = 0;
  for (int c = 2; c < n; ++c) {
    const double volume = std::abs(Dot(normal, p[static_cast<size_t>(c)]));
    if (volume > best) best = volume, best_c = c;
  }
  if (best_c < 0 || best < kSliver * Norm(normal)) return false;
  simplex = {1, best_b, best_c};
  if (Dot(normal, p[static_cast<size_t>(best_c)]) < 0) std::swap(simplex[1], simplex[2]);
  return true;
}

// Replaces the faces that `point` sees by the cone from it to their horizon.
void AddPoint(const std::vector<Vec3>& p, int point, std::vector<Face>& faces) {
  std::vector<std::array<int, 2>> edges;
  for (Face& face : faces) {
    if (Outside(p, face, point) <= 0) continue;
    face.alive = false;
    for (size_t k = 0; k < 3; ++k) edges.push_back({face.at[k], face.at[(k + 1) % 3]});
  }
  std::erase_if(faces, [](const Face& face) { return !face.alive; });
  std::sort(edges.begin(), edges.end());
  for (const auto& edge : edges) {
    const std::array<int, 2> twin = {edge[1], edge[0]};
    if (!std::binary_search(edges.begin(), edges.end(), twin)) {
      faces.push_back({{edge[0], edge[1], point}});
    }
  }
}

}  // namespace

std::vector<std::array<int, 3>> TriangulateSphere(const std::vector<Vec3>& directions) {
  std::vector<Vec3> p = {{0, 0, 0}};
  for (size_t i = 0; i < directions.size(); ++i) {
    p.push_back(directions[i] +
                kJitter * Vec3{Noise(3 * i), Noise(3 * i + 1), Noise(3 * i + 2)});
  }
  std::array<int, 3> s{};
  if (!FindSimplex(p, s)) return {};
  // s is counter-clockwise seen from outside, the origin behind it.
  std::vector<Face> faces = {{{s[0], s[1], s[2]}}, {{0, s[1], s[0]}}, {{0, s[2], s[1]}},
                             {{0, s[0], s[2]}}};
  for (int i = 1; i < static_cast<int>(p.size()); ++i) {
    if (i != s[0] && i != s[1] && i != s[2]) AddPoint(p, i, faces);
  }
  std::vector<std::array<int, 3>> triangles;
  for (const Face& face : faces) {
    if (face.at[0] == 0 || face.at[1] == 0 || face.at[2] == 0) continue;
    const std::array<int, 3> t = {face.at[0] - 1, face.at[1] - 1, face.at[2] - 1};
    if (Height(directions[static_cast<size_t>(t[0])], directions[static_cast<size_t>(t[1])],
               directions[static_cast<size_t>(t[2])]) > kSliver) {
      triangles.push_back(t);
    }
  }
  return triangles;
}

}  // namespace mesorig::btf
