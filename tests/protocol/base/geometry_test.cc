#include "protocol/base/geometry.h"

#include <gtest/gtest.h>

namespace mesorig {
namespace {

TEST(Geometry, AnglesAndDirections) {
  const Vec3 d = DirectionFromAngles(RadFromDeg(60), RadFromDeg(90));
  EXPECT_NEAR(d.x, 0, 1e-15);
  EXPECT_NEAR(d.y, std::sqrt(3) / 2, 1e-15);
  EXPECT_NEAR(d.z, 0.5, 1e-15);
  const Angles a = AnglesFromDirection(DirectionFromAngles(1.1, 5.2));
  EXPECT_NEAR(a.theta_rad, 1.1, 1e-14);
  EXPECT_NEAR(a.phi_rad, 5.2, 1e-14);
  EXPECT_EQ(AnglesFromDirection({0, 0, 1}).phi_rad, 0) << "the pole has no azimuth";
}

TEST(Geometry, AngleBetweenKeepsItsDigitsWhereAcosDoesNot) {
  const Vec3 a{0, 0, 1};
  for (const double angle : {1e-12, 1e-9, 1e-4, 1.0, 3.0, kPi - 1e-9}) {
    const Vec3 b{std::sin(angle), 0, std::cos(angle)};
    EXPECT_NEAR(AngleBetween(a, b), angle, 1e-15 + 1e-10 * std::min(angle, kPi - angle));
  }
}

TEST(Geometry, RotationTurnsCounterClockwiseAndInverts) {
  const Mat3 r = RotationAbout({0, 0, 1}, RadFromDeg(90));
  const Vec3 y = r * Vec3{1, 0, 0};
  EXPECT_NEAR(y.y, 1, 1e-15);
  const RigidTransform t{RotationAbout(Normalized({1, 2, 3}), 0.7), {4, 5, 6}};
  const Vec3 p{-1, 8, 2.5};
  EXPECT_NEAR(Norm(Inverse(t) * (t * p) - p), 0, 1e-14);
}

TEST(Geometry, SegmentDistanceIncludingDegenerateSegments) {
  EXPECT_NEAR(SegmentDistance({0, 0, 0}, {10, 0, 0}, {5, 3, -1}, {5, 3, 1}), 3, 1e-14);
  EXPECT_NEAR(SegmentDistance({0, 0, 0}, {10, 0, 0}, {2, 4, 0}, {8, 4, 0}), 4, 1e-14) << "parallel";
  EXPECT_NEAR(SegmentDistance({0, 0, 0}, {1, 0, 0}, {4, 4, 0}, {4, 8, 0}), 5, 1e-14) << "beyond";
  EXPECT_NEAR(SegmentDistance({0, 0, 0}, {0, 0, 0}, {3, 4, 0}, {3, 4, 0}), 5, 1e-14) << "points";
  EXPECT_NEAR(SegmentDistance({0, 0, 0}, {10, 0, 0}, {5, 0, 0}, {5, 0, 9}), 0, 1e-14) << "touch";
}

}  // namespace
}  // namespace mesorig
