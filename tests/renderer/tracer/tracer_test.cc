// The traced picture of displaced surfaces against closed forms.

#include "renderer/tracer/tracer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "renderer/scene/view_transform.h"
#include "renderer/tracer/silhouette_figures.h"

namespace mesorig::renderer {
namespace {

Object Torus() {
  Object torus;
  torus.shape = Shape::kTorus;
  torus.major_radius_mm = 50;
  torus.minor_radius_mm = 20;
  return torus;
}

// From far above along the axis.
Scene FromAbove(const Object& object) {
  Scene scene;
  scene.image.width = scene.image.height = 160;
  scene.image.msaa = 1;
  scene.camera.eye_mm = {0, 0, 4000};
  scene.camera.up = {0, 1, 0};
  scene.camera.fov_rad = 2 * std::atan(80.0 / 4000);
  scene.lights.push_back({{0, 0, 1}, {kPi, kPi, kPi}});
  scene.objects.push_back(object);
  return scene;
}

TEST(DisplaceSurfaceTest, MovesAlongTheNormalByTheSquareRootOfTheAreaStretch) {
  const Object torus = Torus();
  // A unit is 30 mm of the surface and shows 40 x 40 mm of the sample.
  const auto surface = DisplaceSurface(
      torus, {1.0 / 30, 1.0 / 30}, {40, 40}, [](double, double) { return -2.0; }, 1000);
  ASSERT_TRUE(surface.ok());
  EXPECT_EQ(surface->triangles.size(), 2u * 144 * 72);
  for (const auto& vertex : surface->vertices) {
    const Vec3 p{vertex[0], vertex[1], vertex[2]};
    const double out = std::hypot(p.x, p.y) - 50, phi = std::atan2(p.z, out);
    const double stretch = 0.75 * std::sqrt(1 + 0.4 * std::cos(phi));
    ASSERT_NEAR(std::hypot(out, p.z), 20 - 2 * stretch, 0.02);
  }
}

TEST(DisplaceSurfaceTest, HalvesEdgesWithoutGaps) {
  Object slab;
  slab.size_mm = {40, 30, 10};
  slab.rounding_mm = 3;
  const auto surface = DisplaceSurface(slab, {1.0 / 40, 1.0 / 40}, {40, 40}, nullptr, 2);
  ASSERT_TRUE(surface.ok());
  double area = 0, volume = 0;
  for (const auto& t : surface->triangles) {
    Vec3 p[3];
    for (size_t k = 0; k < 3; ++k) {
      const auto& vertex = surface->vertices[t[k]];
      p[k] = {vertex[0], vertex[1], vertex[2]};
    }
    for (size_t k = 0; k < 3; ++k) ASSERT_LE(Norm(p[k] - p[(k + 1) % 3]), 2.001);
    area += Norm(Cross(p[1] - p[0], p[2] - p[0])) / 2;
    volume += Dot(p[0], Cross(p[1], p[2])) / 6;
  }
  EXPECT_NEAR(area / SurfaceArea(slab), 1, 1e-4);
  const double rounded = 34 * 24 * 4 + 2 * 3 * (34 * 24 + 34 * 4 + 24 * 4) +
                         kPi * 9 * (34 + 24 + 4) + 4 * kPi / 3 * 27;
  EXPECT_NEAR(volume / rounded, 1, 0.005);
  EXPECT_EQ(DisplaceSurface(slab, {1, 1}, {1, 1}, nullptr, 0).status().code(),
            absl::StatusCode::kInvalidArgument);
}

// The height function is asked for places of the sample, texel (0, 0) of the texture top left.
TEST(DisplaceSurfaceTest, TheSampleRepeatsUpright) {
  Object slab;
  slab.size_mm = {100, 100, 10};
  const auto surface = DisplaceSurface(
      slab, {1.0 / 40, 1.0 / 40}, {40, 40},
      [](double x, double y) { return x > 0 && y > 0 ? -1.0 : 0.0; }, 1.7);
  ASSERT_TRUE(surface.ok());
  int low = 0;
  for (size_t i = 0; i < surface->vertices.size(); ++i) {
    const auto& v = surface->vertices[i];
    if (std::max(std::abs(v[0]), std::abs(v[1])) > 48 || v[2] < 0) continue;  // not the top
    const auto wrapped = [](double t) { return t - 40 * std::floor((t + 20) / 40); };
    const double x = wrapped(v[0]), y = wrapped(v[1]);
    if (std::min({std::abs(x), std::abs(y), 20 - std::abs(x), 20 - std::abs(y)}) < 0.01) continue;
    ASSERT_NEAR(v[2], x > 0 && y > 0 ? 4 : 5, 1e-4) << x << ", " << y;
    if (v[2] < 4.5) ++low;
  }
  EXPECT_GT(low, 100);
}

TEST(TracerTest, MasksAreThoseOfTheShrunkTorus) {
  const Object torus = Torus();
  const Scene scene = FromAbove(torus);
  const auto mask = [&](double h) {
    std::vector<SurfaceMesh> surfaces;
    surfaces.push_back(*DisplaceSurface(
        torus, {1.0 / 40, 1.0 / 40}, {40, 40}, [=](double, double) { return -h; }, 1000));
    auto tracer = Tracer::Create(std::move(surfaces));
    EXPECT_TRUE(tracer.ok());
    return tracer->Mask(scene);
  };
  const auto base = mask(0), shrunk = mask(3);
  for (int y = 0; y < 160; ++y) {
    for (int x = 0; x < 160; ++x) {
      const double rho = std::hypot(x + 0.5 - 80, y + 0.5 - 80);
      const auto at = static_cast<size_t>(y * 160 + x);
      for (const auto& [pixels, h] : {std::pair{&base, 0.0}, {&shrunk, 3.0}}) {
        // (At the silhouette the height grows by sqrt(1 +- 0.4 cos) with the normal level.)
        const double outer = 70 - h * std::sqrt(1.4), inner = 30 + h * std::sqrt(0.6);
        if (std::abs(rho - outer) < 1.5 || std::abs(rho - inner) < 1.5) continue;
        ASSERT_EQ((*pixels)[at], rho < outer && rho > inner) << x << ", " << y << ", h " << h;
      }
    }
  }
  const auto figures = CompareInBand(base, shrunk, shrunk, base);
  ASSERT_TRUE(figures.ok());
  EXPECT_GT(figures->band_pixels, 1000u);
  EXPECT_EQ(figures->iou, 0);
}

// Lambert under a light from above, with the shadow of a slab that floats before it.
TEST(TracerTest, ShadesWithShadows) {
  Object ground;
  ground.size_mm = {140, 140, 10};
  Scene scene = FromAbove(ground);
  scene.lights[0].direction = Normalized({1, 0, 1});
  std::vector<SurfaceMesh> surfaces;
  surfaces.push_back(*DisplaceSurface(ground, {1, 1}, {1, 1}, nullptr, 1000));
  Object roof;
  roof.size_mm = {20, 20, 2};
  roof.position_mm = {20, 0, 40};
  surfaces.push_back(*DisplaceSurface(roof, {1, 1}, {1, 1}, nullptr, 1000));
  const auto tracer = Tracer::Create(std::move(surfaces));
  ASSERT_TRUE(tracer.ok());
  const std::vector<float> rgb = {0.2f, 0.1f, 0.0f};
  const Picture picture = tracer->Draw(scene, {1, 1, rgb});
  const auto at = [&](double x, double y, size_t channel) {
    const auto pixel = PixelOf(scene.camera, 160, 160, {x, y, 5});
    return picture
        .rgb[(static_cast<size_t>(pixel[1]) * 160 + static_cast<size_t>(pixel[0])) * 3 + channel];
  };
  // pi * 0.2 * cos 45 = 0.444 is sRGB 177; half of it 128.
  EXPECT_NEAR(at(-50, 30, 0), 177, 2);
  EXPECT_NEAR(at(-50, 30, 1), 129, 2);
  EXPECT_EQ(at(-50, 30, 2), 0);
  EXPECT_EQ(at(-15, 0, 0), 0);  // 35 mm below the roof, shadows fall 35 mm to -x
}

TEST(SilhouetteFiguresTest, CountsInTheBandOnly) {
  const std::vector<uint8_t> base = {0, 1, 1, 1, 1, 1}, shrunk = {0, 0, 0, 0, 0, 1},
                             truth = {1, 1, 1, 0, 0, 0}, drawn = {1, 1, 0, 1, 0, 1};
  const auto figures = CompareInBand(base, shrunk, truth, drawn);
  ASSERT_TRUE(figures.ok());
  EXPECT_EQ(figures->band_pixels, 4u);
  EXPECT_DOUBLE_EQ(figures->iou, 1.0 / 3);
  EXPECT_EQ(CompareInBand(base, base, truth, drawn).status().code(),
            absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(CompareInBand(base, shrunk, truth, {}).status().code(),
            absl::StatusCode::kInvalidArgument);
  const std::vector<uint8_t> none(6, 0);
  EXPECT_DOUBLE_EQ(CompareInBand(base, shrunk, none, none)->iou, 1);
}

}  // namespace
}  // namespace mesorig::renderer
