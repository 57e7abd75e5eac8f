#include "simulator/world/world.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "simulator/world/sample.h"
#include "simulator/world/transport.h"
#include "tests/simulator/world/test_surfaces.h"

namespace mesorig::world {
namespace {

std::unique_ptr<World> Weave() {
  const std::string path = std::string(MESORIG_SOURCE_DIR) + "/rigs/samples/weave.toml";
  return Build(LoadSample(path).value().surface);
}

double HeightAt(const World& world, double x, double y) {
  const auto hit = world.FirstHit({x, y, 100}, {0, 0, -1});
  return hit ? hit->p.z : -1;
}

TEST(World, PlaneIsHitWhereItIs) {
  const auto world = Build(Plane(2, Lambert(0.5, 0.5, 0.5)));
  EXPECT_EQ(world->top_mm(), 2);
  const Vec3 d = Normalized({1, 2, -3});
  const auto hit = world->FirstHit(Vec3{3, 4, 2} - 500 * d, d);
  ASSERT_TRUE(hit);
  EXPECT_NEAR(Norm(hit->p - Vec3{3, 4, 2}), 0, 1e-4);
  EXPECT_NEAR(hit->normal.z, 1, 1e-6);
}

TEST(World, RaysBesideAndFromBelowHitNothing) {
  const auto world = Build(Plane(2, Lambert(0.5, 0.5, 0.5)));
  EXPECT_FALSE(world->FirstHit({31, 0, 100}, {0, 0, -1}));
  EXPECT_FALSE(world->FirstHit({0, 0, -10}, {0, 0, 1}));
  EXPECT_FALSE(world->FirstHit({0, 0, 100}, {0, 0, 1}));
  EXPECT_FALSE(world->FirstHit({0, 0, 100}, {1, 0, 0}));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(world->FirstHit({nan, 0, 100}, {0, 0, -1}));
}

TEST(World, RefusesImpossibleSurfaces) {
  EXPECT_FALSE(World::Build(Plane(-1, {})).ok());
  EXPECT_FALSE(World::Build(Plane(std::nan(""), {})).ok());
  EXPECT_FALSE(World::Build(Plane(1, {}, 0)).ok());
  EXPECT_FALSE(World::Build(Plane(1, {}, 1e6)).ok());
}

// The letter F of rigs/samples/weave.toml, by its numbers: x from -6.5 to 8.5, y from -12 to 12,
// strokes of 5 mm. Stem x -6.5..-1.5; upper bar y 7..12; lower bar y -3.46..1.54 up to x = 5.5.
// On its top the relief is at least 3.2 mm; the weave alone reaches 3.0 mm.
TEST(World, LetterStandsUnmirrored) {
  const auto world = Weave();
  for (auto [x, y] : {std::pair{-4.0, -10.0}, {-4.0, 4.0}, {6.5, 9.5}, {0.0, 9.5}, {4.0, -1.0}}) {
    EXPECT_GT(HeightAt(*world, x, y), 3.15) << x << ", " << y;
  }
  // Where its mirror images and its turned image would stand, and between its bars.
  for (auto [x, y] : {std::pair{6.0, -10.0}, {7.2, -1.0}, {5.0, 4.3}, {6.5, -9.5}, {0.5, -9.5}}) {
    EXPECT_LT(HeightAt(*world, x, y), 3.05) << x << ", " << y;
  }
}

TEST(World, WeaveHasARelief) {
  const auto world = Weave();
  double low = 10, high = 0;
  for (double y = -20; y <= 20; y += 0.1) {
    for (double x = -20; x <= 20; x += 0.1) {
      const double z = HeightAt(*world, x, y);
      low = std::min(low, z), high = std::max(high, z);
    }
  }
  EXPECT_GE(high - low, 3);
  EXPECT_LT(high, 4.2);
}

// By hand: at (2, 2), the middle of thread 0 of both directions, the warp is over: 1 + 0.8 + 1.2.
// At (6, 2) the weft is.
TEST(World, WeaveGoesOverAndUnder) {
  const auto world = Weave();
  EXPECT_NEAR(HeightAt(*world, -14, -14), 3.0, 0.01);
  const auto warp = world->FirstHit({-14, -14, 100}, {0, 0, -1});
  const auto weft = world->FirstHit({-10, -14, 100}, {0, 0, -1});
  ASSERT_TRUE(warp && weft);
  EXPECT_GT(warp->material.diffuse[0], warp->material.diffuse[2]);  // ochre along y
  EXPECT_LT(weft->material.diffuse[0], weft->material.diffuse[2]);  // blue along x
}

// One hit lit by hand: rho / pi cos(theta) / d^2.
TEST(Transport, LambertPlane) {
  const auto world = Build(Plane(1, Lambert(0.9, 0.6, 0.3)));
  const auto hit = world->FirstHit({5, 5, 100}, {0, 0, -1});
  ASSERT_TRUE(hit);
  HitRow row;
  row.Add(*hit, {0, 0, 1}, 7, -1);
  ASSERT_EQ(row.blocks().size(), 1u);
  EXPECT_EQ(row.blocks()[0].target[0], 7u);
  Response response;
  for (double theta_deg : {0.0, 20.0, 45.0, 70.0, 85.0, 89.0}) {
    const Vec3 l = DirectionFromAngles(RadFromDeg(theta_deg), 1.1);
    Illuminate(*world, row.blocks()[0], {l, true}, 3, response);
    for (int c = 0; c < 3; ++c) {
      const double expected = (0.9 - 0.3 * c) / kPi * l.z;
      EXPECT_NEAR(response.value[c][0], expected, 1e-6) << theta_deg;
      EXPECT_EQ(response.value[c][1], 0);  // an empty lane
    }
    Illuminate(*world, row.blocks()[0], {Vec3{5, 5, 1} + 650 * l, false}, 1, response);
    EXPECT_NEAR(response.value[0][0] * 650 * 650, 0.9 / kPi * l.z, 5e-6) << theta_deg;
  }
  Illuminate(*world, row.blocks()[0], {{0, 0, -1}, true}, 3, response);
  EXPECT_EQ(response.value[0][0], 0);
}

// A wall of height h throws a shadow of length h tan(theta).
TEST(Transport, StepThrowsAShadowOfTheRightLength) {
  const double h = 3;
  const auto world = Build(Step(h, 0.05));
  for (double theta_deg : {20.0, 45.0, 60.0, 75.0}) {
    const Light light{DirectionFromAngles(RadFromDeg(theta_deg), kPi), true};  // from -x
    const double length = h * std::tan(RadFromDeg(theta_deg));
    const auto lit = [&](double x) {
      const auto hit = world->FirstHit({x, 0.3, 50}, {0, 0, -1});
      HitRow row;
      row.Add(*hit, {0, 0, 1}, 0, -1);
      Response response;
      Illuminate(*world, row.blocks()[0], light, 1, response);
      return response.value[0][0] > 0;
    };
    // The wall is one cell wide: its upper edge stands at x = -0.05.
    EXPECT_FALSE(lit(0.01)) << theta_deg;
    EXPECT_FALSE(lit(length - 0.05 - 0.02)) << theta_deg;
    EXPECT_TRUE(lit(length - 0.05 + 0.02)) << theta_deg;
    EXPECT_TRUE(lit(-0.2)) << theta_deg;
  }
}

}  // namespace
}  // namespace mesorig::world
