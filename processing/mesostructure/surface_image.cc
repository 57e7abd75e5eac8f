#include "processing/mesostructure/surface_image.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "protocol/base/check.h"

namespace mesorig::mesostructure {
namespace {

constexpr double kFarthest_mm = 1e6;
constexpr double kEdge = 1e-9;  // of a triangle's area: an edge belongs to both its triangles

class Canvas {
 public:
  Canvas(const Product& product, std::span<float> distance, std::span<float> weight)
      : product_(product), distance_(distance), weight_(weight) {
    std::fill(distance.begin(), distance.end(), 0.0f);
    std::fill(weight.begin(), weight.end(), 0.0f);
  }

  // In texels: centres have whole coordinates.
  SurfacePoint ToTexels(SurfacePoint p) const {
    p.x = p.x / product_.pitch_mm + product_.width_px / 2.0 - 0.5;
    p.y = product_.height_px / 2.0 - 0.5 - p.y / product_.pitch_mm;
    return p;
  }

  void Triangle(const SurfacePoint& a, const SurfacePoint& b, const SurfacePoint& c) {
    const double area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if (!(std::abs(area) > 1e-12)) return;  // seen edge-on; also NaN
    const int i0 = Low(std::min({a.x, b.x, c.x})), j0 = Low(std::min({a.y, b.y, c.y}));
    const int i1 = High(std::max({a.x, b.x, c.x}), product_.width_px);
    const int j1 = High(std::max({a.y, b.y, c.y}), product_.height_px);
    for (int j = j0; j <= j1; ++j) {
      for (int i = i0; i <= i1; ++i) {
        const double s = ((i - a.x) * (c.y - a.y) - (c.x - a.x) * (j - a.y)) / area;
        const double t = ((b.x - a.x) * (j - a.y) - (i - a.x) * (b.y - a.y)) / area;
        if (s < -kEdge || t < -kEdge || s + t > 1 + kEdge) continue;
        Put(i, j, a.distance + s * (b.distance - a.distance) + t * (c.distance - a.distance),
            a.weight + s * (b.weight - a.weight) + t * (c.weight - a.weight));
      }
    }
  }

  void Put(int i, int j, double distance, double weight) {
    const auto at =
        static_cast<size_t>(j) * static_cast<size_t>(product_.width_px) + static_cast<size_t>(i);
    if (!(distance < kFarthest_mm && distance > -kFarthest_mm)) return;  // also NaN
    if (!(weight > 0) || (weight_[at] > 0 && distance_[at] <= distance)) return;
    distance_[at] = static_cast<float>(std::max(distance, 0.0));
    weight_[at] = static_cast<float>(weight);
  }

  bool Covered(int i, int j) const {
    return weight_[static_cast<size_t>(j) * static_cast<size_t>(product_.width_px) +
                   static_cast<size_t>(i)] > 0;
  }
  bool Inside(int i, int j) const {
    return i >= 0 && j >= 0 && i < product_.width_px && j < product_.height_px;
  }

 private:
  // Clamped before it becomes an int: points may lie anywhere.
  static int Low(double x) { return static_cast<int>(std::ceil(std::clamp(x - kEdge, 0.0, 1e6))); }
  static int High(double x, int size) {
    return static_cast<int>(std::floor(std::clamp(x + kEdge, -1.0, size - 1.0)));
  }

  const Product& product_;
  const std::span<float> distance_, weight_;
};

bool Joined(const SurfacePoint& a, const SurfacePoint& b, double pitch_mm) {
  const double apart = pitch_mm * std::hypot(a.x - b.x, a.y - b.y);
  return std::abs(a.distance - b.distance) <= kStep_mm + kSteepest * apart;
}

}  // namespace

void DrawSurface(std::span<const SurfacePoint> points, int columns, int rows,
                 const Product& product, std::span<float> distance, std::span<float> weight) {
  const auto texels =
      static_cast<size_t>(product.width_px) * static_cast<size_t>(product.height_px);
  MESORIG_CHECK(points.size() == static_cast<size_t>(columns) * static_cast<size_t>(rows));
  MESORIG_CHECK(distance.size() == texels && weight.size() == texels);
  Canvas canvas(product, distance, weight);
  std::vector<SurfacePoint> at;
  at.reserve(points.size());
  for (const SurfacePoint& p : points) at.push_back(canvas.ToTexels(p));
  const auto triangle = [&](const SurfacePoint& a, const SurfacePoint& b, const SurfacePoint& c) {
    if (!(a.weight > 0 && b.weight > 0 && c.weight > 0)) return;
    const double pitch = product.pitch_mm;
    if (Joined(a, b, pitch) && Joined(b, c, pitch) && Joined(c, a, pitch)) canvas.Triangle(a, b, c);
  };
  for (int j = 0; j + 1 < rows; ++j) {
    for (int i = 0; i + 1 < columns; ++i) {
      const SurfacePoint* p = at.data() + static_cast<ptrdiff_t>(j) * columns + i;
      triangle(p[0], p[1], p[columns + 1]);
      triangle(p[0], p[columns + 1], p[columns]);
    }
  }
  // What quads have covered stays as it is; among points the nearest wins.
  std::vector<std::array<int, 2>> cells(points.size(), {-1, -1});
  for (size_t k = 0; k < at.size(); ++k) {
    if (!(at[k].weight > 0) || !(std::abs(at[k].x) < 1e6 && std::abs(at[k].y) < 1e6)) continue;
    const int i = static_cast<int>(std::lround(at[k].x)),
              j = static_cast<int>(std::lround(at[k].y));
    if (canvas.Inside(i, j) && !canvas.Covered(i, j)) cells[k] = {i, j};
  }
  for (size_t k = 0; k < at.size(); ++k) {
    if (cells[k][0] >= 0) canvas.Put(cells[k][0], cells[k][1], at[k].distance, 0.5 * at[k].weight);
  }
}

}  // namespace mesorig::mesostructure
