#include "simulator/plant/motion_profile.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace mesorig::plant {
namespace {

constexpr MotionLimits kLimits{30, 60};

// Finite differences along the profile: no limit exceeded, no jump in position or velocity.
void ExpectWithinLimits(const MotionProfile& profile, double v0, MotionLimits limits) {
  const double end = profile.duration_s();
  ASSERT_TRUE(std::isfinite(end) && end >= 0);
  const int steps = 2000;
  const double dt = std::max(end, 1e-9) / steps;
  const double v_limit = std::max(limits.velocity, std::abs(v0));
  for (int i = -2; i < steps + 2; ++i) {
    const double t = i * dt;
    const double p0 = profile.Position(t), p1 = profile.Position(t + dt);
    const double scale = 1e-9 * (1 + std::abs(p0)) / dt;
    ASSERT_LE(std::abs(p1 - p0) / dt, v_limit * (1 + 1e-9) + scale) << t;
    if (i < 0) continue;  // before the start it stands at the start
    const double u0 = profile.Velocity(t), u1 = profile.Velocity(t + dt);
    ASSERT_LE(std::abs(u1 - u0) / dt, limits.acceleration * (1 + 1e-6) + 1e-9 * v_limit / dt) << t;
    ASSERT_NEAR(p1 - p0, 0.5 * (u0 + u1) * dt, 0.25 * limits.acceleration * dt * dt + scale * dt)
        << t;
  }
}

// 90 units at 30/s, 60/s^2: 0.5 s to speed over 7.5 units, 75 units cruise in 2.5 s, 0.5 s to stop.
TEST(MotionProfile, TrapezoidByHand) {
  const MotionProfile p = MotionProfile::To(10, 0, 100, kLimits);
  EXPECT_DOUBLE_EQ(p.duration_s(), 3.5);
  EXPECT_DOUBLE_EQ(p.Position(0.5), 17.5);
  EXPECT_DOUBLE_EQ(p.Position(1.5), 47.5);
  EXPECT_DOUBLE_EQ(p.Velocity(1.5), 30);
  EXPECT_DOUBLE_EQ(p.Position(3.25), 100 - 0.5 * 60 * 0.25 * 0.25);
  EXPECT_EQ(p.Position(3.5), 100);
  EXPECT_EQ(p.Position(1e9), 100);
  EXPECT_EQ(p.Position(-1), 10);
  ExpectWithinLimits(p, 0, kLimits);
}

// 6 units: peak sqrt(60 * 6) = 18.97 stays below 30; 2 * sqrt(6/60) s.
TEST(MotionProfile, TriangleByHand) {
  const MotionProfile p = MotionProfile::To(0, 0, -6, kLimits);
  EXPECT_NEAR(p.duration_s(), 2 * std::sqrt(0.1), 1e-12);
  EXPECT_NEAR(p.Velocity(p.duration_s() / 2), -std::sqrt(360), 1e-9);
  EXPECT_NEAR(p.Position(p.duration_s() / 2), -3, 1e-9);
  EXPECT_EQ(p.Position(p.duration_s()), -6);
  ExpectWithinLimits(p, 0, kLimits);
}

TEST(MotionProfile, NoWayTakesNoTime) {
  const MotionProfile p = MotionProfile::To(5, 0, 5, kLimits);
  EXPECT_EQ(p.duration_s(), 0);
  EXPECT_EQ(p.Position(0), 5);
  EXPECT_EQ(p.Velocity(0), 0);
}

TEST(MotionProfile, TinyWays) {
  for (double way : {1.0, 1e-3, 1e-9, 1e-15, 1e-300}) {
    const MotionProfile p = MotionProfile::To(0, 0, way, kLimits);
    EXPECT_NEAR(p.duration_s(), 2 * std::sqrt(way / 60), 1e-9 + 1e-9 * p.duration_s());
    EXPECT_EQ(p.Position(p.duration_s()), way);
  }
}

// At +30 towards a target behind: 0.5 s and 7.5 units to stop, then the way back.
TEST(MotionProfile, Reversal) {
  const MotionProfile p = MotionProfile::To(0, 30, -52.5, kLimits);
  // From 7.5 back over 60 units: 0.5 + (60 - 15) / 30 + 0.5 = 2.5 s.
  EXPECT_NEAR(p.duration_s(), 3.0, 1e-12);
  EXPECT_NEAR(p.Position(0.5), 7.5, 1e-12);
  EXPECT_NEAR(p.Velocity(0.5), 0, 1e-12);
  EXPECT_EQ(p.Position(3.0), -52.5);
  ExpectWithinLimits(p, 30, kLimits);
}

TEST(MotionProfile, TooFastToStopInTime) {
  const MotionProfile p = MotionProfile::To(0, 30, 2, kLimits);  // needs 7.5 to stop
  EXPECT_NEAR(p.Position(0.5), 7.5, 1e-9);
  EXPECT_EQ(p.Position(p.duration_s()), 2);
  ExpectWithinLimits(p, 30, kLimits);
}

TEST(MotionProfile, FasterThanTheLimitBrakesToIt) {
  const MotionProfile p = MotionProfile::To(0, 60, 100, kLimits);
  EXPECT_NEAR(p.Velocity(0.5), 30, 1e-9);
  EXPECT_EQ(p.Position(p.duration_s()), 100);
  ExpectWithinLimits(p, 60, kLimits);
}

TEST(MotionProfile, Stop) {
  const MotionProfile p = MotionProfile::Stop(10, -30, 60);
  EXPECT_DOUBLE_EQ(p.duration_s(), 0.5);
  EXPECT_DOUBLE_EQ(p.target(), 2.5);
  EXPECT_EQ(p.Velocity(0.5), 0);
  EXPECT_EQ(MotionProfile::Stop(3, 0, 60).duration_s(), 0);
}

// Any start, any target: within the limits, and continuous up to the exact target.
TEST(MotionProfile, RandomMoves) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int i = 0; i < 300; ++i) {
    const MotionLimits limits{std::exp(4 * uniform(random)), std::exp(4 * uniform(random))};
    const double v0 = i % 3 == 0 ? 0 : 1.5 * limits.velocity * uniform(random);
    const double p0 = 100 * uniform(random), target = 100 * uniform(random);
    const MotionProfile p = MotionProfile::To(p0, v0, target, limits);
    ExpectWithinLimits(p, v0, limits);
    ASSERT_NEAR(p.Position(p.duration_s() * (1 - 1e-12)), target, 1e-6);
    // Interrupted half way, a new target takes over without a jump.
    const double t = p.duration_s() / 2;
    const MotionProfile q = MotionProfile::To(p.Position(t), p.Velocity(t), -target, limits);
    ASSERT_NEAR(q.Position(0), p.Position(t), 1e-9);
    ExpectWithinLimits(q, p.Velocity(t), limits);
  }
}

}  // namespace
}  // namespace mesorig::plant
