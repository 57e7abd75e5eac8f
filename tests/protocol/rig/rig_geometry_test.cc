// Golden numbers computed by hand: simulator and processing share this geometry, so nothing but
// numbers from outside can show a wrong sign.

#include "protocol/rig/rig_geometry.h"

#include <gtest/gtest.h>

#include <limits>
#include <string>

#include "protocol/base/file_writer.h"

namespace mesorig {
namespace {

Rig Demo() { return LoadRig(std::string(MESORIG_SOURCE_DIR) + "/rigs/demo.toml").value(); }

std::vector<double> Angles(double turntable_deg, double light_arc_deg) {
  return {RadFromDeg(turntable_deg), RadFromDeg(light_arc_deg)};
}

void ExpectNear(Vec3 actual, Vec3 expected, double tolerance) {
  EXPECT_NEAR(actual.x, expected.x, tolerance);
  EXPECT_NEAR(actual.y, expected.y, tolerance);
  EXPECT_NEAR(actual.z, expected.z, tolerance);
}

// The sample's point (10.25, 5.25, 4) mm with the turntable at 30 degrees. By hand, with
// cos 30 = 0.8660254 and sin 30 = 0.5:
//   x_world = 10.25 * 0.8660254 - 5.25 * 0.5       =  8.8767604 - 2.625     =  6.2517604
//   y_world = 10.25 * 0.5       + 5.25 * 0.8660254 =  5.125     + 4.5466334 =  9.6716334
//   z_world = 4.
constexpr Vec3 kPoint{10.25, 5.25, 4};
constexpr Vec3 kPointInWorld{6.2517604, 9.6716334, 4};

TEST(RigGeometry, GoldenPointInWorld) {
  ExpectNear(WorldFromSample(Demo(), Angles(30, 0)) * kPoint, kPointInWorld, 1e-6);
}

// cam0 hangs at (0, 0, 800) and looks down. Its image down is the direction of growing theta at
// azimuth 0, world +x, and its image right is e_phi, world +y (down, right and forward are
// right-handed: y x x = -z). So with depth 800 - 4 = 796:
//   u = 128 + 2600 *  9.6716334 / 796 = 128 + 31.590762 = 159.590762
//   v =  96 + 2600 *  6.2517604 / 796 =  96 + 20.420323 = 116.420323
TEST(RigGeometry, GoldenPixelFromTheZenith) {
  const Rig rig = Demo();
  const Camera& camera = rig.cameras[0];
  ASSERT_EQ(camera.name, "cam0");
  const auto pixel = Project(
      camera, Inverse(SampleFromCamera(rig, 0, Angles(30, 0))) * kPoint);
  ASSERT_TRUE(pixel.has_value());
  EXPECT_NEAR(pixel->u, 159.590762, 1e-5);
  EXPECT_NEAR(pixel->v, 116.420323, 1e-5);
}

// cam5 stands at theta = 60 degrees, azimuth 0: d = (0.8660254, 0, 0.5), 800 mm away. Down in its
// image is e_theta = (cos 60, 0, -sin 60) = (0.5, 0, -0.8660254), right is e_phi = (0, 1, 0).
//   depth = 800 - (0.8660254 * 6.2517604 + 0.5 * 4) = 800 - (5.4141833 + 2) = 792.5858167
//   right = 9.6716334
//   down  = 0.5 * 6.2517604 - 0.8660254 * 4 = 3.1258802 - 3.4641016 = -0.3382214
//   u = 128 + 2600 * 9.6716334 / 792.5858167  = 128 + 31.726845 = 159.726845
//   v =  96 - 2600 * 0.3382214 / 792.5858167  =  96 -  1.109502 =  94.890498
TEST(RigGeometry, GoldenPixelFromTheSide) {
  const Rig rig = Demo();
  ASSERT_EQ(rig.cameras[5].name, "cam5");
  const auto pixel = Project(
      rig.cameras[5], Inverse(SampleFromCamera(rig, 5, Angles(30, 0))) * kPoint);
  ASSERT_TRUE(pixel.has_value());
  EXPECT_NEAR(pixel->u, 159.726845, 1e-4);
  EXPECT_NEAR(pixel->v, 94.890498, 1e-4);
}

// lamp5 stands at theta = 60 degrees on the light arc. With the arc at 90 and the turntable at 30
// degrees its azimuth in the sample frame is 90 - 30 = 60:
//   l = (sin 60 cos 60, sin 60 sin 60, cos 60) = (0.4330127, 0.75, 0.5), times 650 mm.
TEST(RigGeometry, GoldenLampInSample) {
  const Rig rig = Demo();
  ASSERT_EQ(rig.lamps[5].name, "lamp5");
  ExpectNear(LampInSample(rig, 5, Angles(30, 90)), {281.458256, 487.5, 325}, 1e-5);
}

// cam5 in the sample frame: azimuth 0 - 30 = -30 degrees,
//   800 * (sin 60 cos 30, -sin 60 sin 30, cos 60) = 800 * (0.75, -0.4330127, 0.5).
TEST(RigGeometry, GoldenCameraInSample) {
  ExpectNear(SampleFromCamera(Demo(), 5, Angles(30, 90)).translation, {600, -346.410162, 400},
             1e-5);
}

TEST(RigGeometry, RayThroughAPixelMeetsItsPoint) {
  const Rig rig = Demo();
  for (int c = 0; c < 8; ++c) {
    const Vec3 p = Inverse(SampleFromCamera(rig, c, Angles(217, 0))) * kPoint;
    const auto pixel = Project(rig.cameras[c], p);
    ASSERT_TRUE(pixel.has_value());
    ExpectNear(Norm(p) * RayDirection(rig.cameras[c], *pixel), p, 1e-9);
  }
}

TEST(RigGeometry, NothingBehindTheCameraIsSeen) {
  const Camera camera = Demo().cameras[0];
  EXPECT_FALSE(Project(camera, {0, 0, -1}).has_value());
  EXPECT_FALSE(Project(camera, {0, 0, 0}).has_value());
  EXPECT_FALSE(Project(camera, {1, 1, std::numeric_limits<double>::quiet_NaN()}).has_value());
}

// A sample disc of radius 20 at the origin, one solid, a point 1000 mm up.
Rig OneSolid(Vec3 a, Vec3 b, double radius) {
  Rig rig;
  rig.sample_radius_mm = 20;
  rig.frames.push_back({.name = "sample", .parent = -1, .translation_mm = {}});
  rig.solids.push_back({.name = "rod", .frame = -1, .a_in_frame = a, .b_in_frame = b,
                        .radius_mm = radius});
  return rig;
}

// Seen from (0, 0, 1000), the cone at z = 500 has radius 10; its side leans inward by 20/1000, so
// a rod of radius 5 along y at x = d is met when (d - 10) cos(atan 0.02) < 5: d < 15.001.
TEST(BlockedBy, RodAtHalfWay) {
  const Vec3 eye{0, 0, 1000};
  for (double d : {0.0, 8.0, 14.9, 14.99}) {
    EXPECT_TRUE(BlockedBy(OneSolid({d, -100, 500}, {d, 100, 500}, 5), eye, {})) << d;
  }
  for (double d : {15.01, 15.1, 30.0}) {
    EXPECT_FALSE(BlockedBy(OneSolid({d, -100, 500}, {d, 100, 500}, 5), eye, {})) << d;
  }
}

// From the side the disc is foreshortened: at theta = 80 degrees its half width in the plane of
// incidence is 20 cos 80 = 3.47, so that at half way the bundle is 1.74 high. A rod that lies
// across at height h over the bundle's axis is met below 1.74 + radius; a cylinder of the disc's
// radius would have been met far higher.
TEST(BlockedBy, GrazingBundleIsFlat) {
  const Vec3 direction = DirectionFromAngles(RadFromDeg(80), 0);
  const Vec3 up{-std::cos(RadFromDeg(80)), 0, std::sin(RadFromDeg(80))};
  const auto blocked = [&](double h) {
    const Vec3 middle = 500 * direction + h * up;
    return BlockedBy(OneSolid(middle - Vec3{0, 100, 0}, middle + Vec3{0, 100, 0}, 2),
                     1000 * direction, {})
        .has_value();
  };
  EXPECT_TRUE(blocked(3.6));
  EXPECT_FALSE(blocked(3.9));
}

TEST(BlockedBy, SolidBehindThePointOrTheSampleDoesNotBlock) {
  EXPECT_FALSE(BlockedBy(OneSolid({0, 0, 1100}, {0, 0, 1200}, 20), {0, 0, 1000}, {}));
  EXPECT_FALSE(BlockedBy(OneSolid({0, 0, -100}, {0, 0, -50}, 20), {0, 0, 1000}, {}));
}

TEST(BlockedBy, OwnMountCountsOnlyBeyondItsThickness) {
  // The lamp sits in a housing of radius 15: its surroundings of 30 mm do not count.
  EXPECT_FALSE(BlockedBy(OneSolid({0, 0, 990}, {0, 0, 1050}, 15), {0, 0, 1000}, {}));
  // The same solid drawn 300 mm towards the sample does.
  EXPECT_TRUE(BlockedBy(OneSolid({0, 0, 700}, {0, 0, 1050}, 15), {0, 0, 1000}, {}));
}

TEST(BlockedBy, PositionsThatAreNoNumbersAreBlocked) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(BlockedBy(OneSolid({0, 300, 500}, {0, 300, 600}, 5), {nan, 0, 1000}, {}));
}

}  // namespace
}  // namespace mesorig
