#include "processing/mesostructure/surface_image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace mesorig::mesostructure {
namespace {

constexpr int kSize = 20;
const Product kProduct{kSize, kSize, 0.5, 4.0};  // 10 mm x 10 mm

struct Drawn {
  std::vector<float> distance = std::vector<float>(kSize * kSize);
  std::vector<float> weight = std::vector<float>(kSize * kSize);
  size_t covered() const {
    return static_cast<size_t>(
        std::count_if(weight.begin(), weight.end(), [](float w) { return w > 0; }));
  }
};

// Points `dx` by `dy` mm apart, from the top left, as a camera's rows run.
template <typename DistanceAt>
Drawn Draw(double dx, double dy, const DistanceAt& distance_at) {
  const int columns = static_cast<int>(10 / dx) + 3, rows = static_cast<int>(10 / dy) + 3;
  std::vector<SurfacePoint> points;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const double x = -5 + (i - 1) * dx, y = 5 - (j - 1) * dy;
      points.push_back({x, y, distance_at(x, y), 0.5});
    }
  }
  Drawn drawn;
  DrawSurface(points, columns, rows, kProduct, drawn.distance, drawn.weight);
  return drawn;
}

TEST(SurfaceImage, NoHolesThoughPixelsStandFourTexelsApart) {
  const auto ramp = [](double x, double y) { return 1 + 0.1 * x - 0.05 * y; };
  for (const double dy : {0.2, 0.7, 2.0}) {
    const Drawn drawn = Draw(0.3, dy, ramp);
    EXPECT_EQ(drawn.covered(), 400u) << dy;
    for (int j = 0; j < kSize; ++j) {
      for (int i = 0; i < kSize; ++i) {
        const double x = (i + 0.5 - kSize / 2.0) * 0.5, y = (kSize / 2.0 - j - 0.5) * 0.5;
        EXPECT_NEAR(drawn.distance[static_cast<size_t>(j * kSize + i)], ramp(x, y), 1e-5);
      }
    }
  }
}

TEST(SurfaceImage, NothingIsDrawnAcrossADepthStep) {
  const Drawn drawn = Draw(0.3, 0.3, [](double x, double) { return x < 0.1 ? 1.0 : 3.0; });
  EXPECT_GT(drawn.covered(), 380u);
  for (size_t k = 0; k < 400; ++k) {
    if (!(drawn.weight[k] > 0)) continue;
    EXPECT_TRUE(drawn.distance[k] == 1.0f || drawn.distance[k] == 3.0f) << drawn.distance[k];
  }
}

TEST(SurfaceImage, TheNearerWinsInWhateverOrder) {
  std::vector<SurfacePoint> points;
  // Two sheets, one over the other, in one image: rows 0 and 1 near, 2 and 3 far.
  for (const double distance : {1.0, 1.0, 3.0, 3.0}) {
    const double y = points.size() / 2 % 2 == 0 ? 4.0 : -4.0;
    points.push_back({-4, y, distance, 1}), points.push_back({4, y, distance, 1});
  }
  Drawn a, b;
  DrawSurface(points, 2, 4, kProduct, a.distance, a.weight);
  std::reverse(points.begin(), points.end());
  DrawSurface(points, 2, 4, kProduct, b.distance, b.weight);
  EXPECT_EQ(a.distance, b.distance);
  EXPECT_EQ(a.distance[10 * kSize + 10], 1.0f);
}

TEST(SurfaceImage, PointsAnywhereAndNan) {
  const double infinity = std::numeric_limits<double>::infinity(), nan = std::nan("");
  for (const double odd : {infinity, -infinity, nan, 1e300, -1e18, 1e9}) {
    const Drawn drawn = Draw(1.0, 1.0, [&](double x, double y) {
      return std::abs(x) < 1.5 && std::abs(y) < 1.5 ? odd : 2.0;
    });
    for (size_t k = 0; k < 400; ++k) {
      EXPECT_FALSE(std::isnan(drawn.distance[k]) || drawn.distance[k] < 0);
    }
    std::vector<SurfacePoint> points(9, SurfacePoint{odd, odd, 1, 1});
    points[4] = {0, 0, 1, 1};
    Drawn thrown;
    DrawSurface(points, 3, 3, kProduct, thrown.distance, thrown.weight);
    EXPECT_LE(thrown.covered(), 400u);
  }
  Drawn none;
  DrawSurface({}, 0, 0, kProduct, none.distance, none.weight);
  EXPECT_EQ(none.covered(), 0u);
}

}  // namespace
}  // namespace mesorig::mesostructure
