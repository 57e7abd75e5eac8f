#include "simulator/plant/geared_motor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace mesorig::plant {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;

TEST(GearedMotor, RunsUpWithFirstOrderLag) {
  GearedMotor motor(0);
  motor.Drive(2, 0.05, seconds(1));
  EXPECT_EQ(motor.Angle(seconds(1)), 0);
  EXPECT_NEAR(motor.Speed(milliseconds(1050)), 2 * (1 - std::exp(-1)), 1e-12);
  // After the run-up it is tau * speed behind one that ran at once.
  EXPECT_NEAR(motor.Angle(seconds(3)), 2 * 2 - 2 * 0.05, 1e-12);
  EXPECT_NEAR(motor.Speed(seconds(3)), 2, 1e-12);
}

TEST(GearedMotor, BrakesToAStandstillThatLasts) {
  GearedMotor motor(0);
  motor.Drive(-3, 0.05, {});
  motor.Drive(0, 0.02, seconds(2));
  const double at = motor.Angle(seconds(2));
  // speed tau, less what friction takes: it holds at kStandstill.
  const double rest = motor.Angle(seconds(9));
  EXPECT_NEAR(rest, at - (3 - kStandstill_rad_s) * 0.02, 1e-9);
  EXPECT_EQ(motor.Speed(seconds(9)), 0);
  EXPECT_EQ(motor.Angle(seconds(10000)), rest);
}

// Where it stands in the end does not depend on how exactly it came.
TEST(GearedMotor, CoggingTurnsItToADetent) {
  constexpr double kDetent = 0.01;
  double rests[2];
  for (const int k : {0, 1}) {
    GearedMotor motor(0.004, kDetent);
    motor.Drive(3, 0.05, {});
    motor.Drive(0, 0.02, seconds(2) + nanoseconds(1000 * k));
    EXPECT_NE(std::remainder(motor.Angle(seconds(2) + milliseconds(5)), kDetent), 0) << "it turns";
    rests[k] = motor.Angle(seconds(9));
    EXPECT_NEAR(std::remainder(rests[k], kDetent), 0, 1e-12);
    EXPECT_NEAR(motor.Driven(seconds(9)), rests[k], 0.002 + 1e-12) << "within the play";
    motor.Drive(3, 0.05, seconds(9));
    EXPECT_EQ(motor.Angle(seconds(9)), rests[k]);
  }
  EXPECT_EQ(rests[0], rests[1]);
}

TEST(GearedMotor, KnowsWhenItGetsThere) {
  for (double speed : {0.3, -0.3, 5.0, -5.0}) {
    for (double before : {0.0, 4.0, -4.0}) {
      GearedMotor motor(0);
      motor.Drive(before, 0.05, {});
      motor.Drive(speed, 0.06, seconds(1));
      const double limit = motor.Angle(seconds(1)) + std::copysign(2.5, speed);
      const RigTime at = motor.WhenAt(limit);
      ASSERT_NE(at, kNever);
      EXPECT_NEAR(motor.Angle(at), limit, 1e-8 * std::abs(speed) + 1e-9);
      EXPECT_LT(std::copysign(1, speed) * (motor.Angle(at - milliseconds(1)) - limit), 0);
    }
  }
}

TEST(GearedMotor, GetsThereAtOnceOrNever) {
  GearedMotor motor(0);
  EXPECT_EQ(motor.WhenAt(1), kNever) << "it stands";
  motor.Drive(1, 0.05, seconds(1));
  EXPECT_EQ(motor.WhenAt(0), RigTime(seconds(1)));
  EXPECT_EQ(motor.WhenAt(-5), RigTime(seconds(1)));
  EXPECT_EQ(motor.WhenAt(1e30), kNever);
}

// One turn forward takes up half the play, the way back the whole of it.
TEST(GearedMotor, PlayIsTakenUpBeforeTheDrivenSideMoves) {
  GearedMotor motor(0.5);
  motor.Drive(1, 0.01, {});
  motor.Drive(0, 0.01, seconds(2));
  const double there = motor.Angle(seconds(3));
  EXPECT_NEAR(motor.Driven(seconds(3)), there - 0.25, 1e-12);
  motor.Drive(-1, 0.01, seconds(3));
  EXPECT_EQ(motor.Driven(milliseconds(3400)), there - 0.25) << "within the play";
  EXPECT_NEAR(motor.Driven(seconds(5)), motor.Angle(seconds(5)) + 0.25, 1e-12);
}

// The closed form is the play operator: against ten thousand small steps over random commands.
TEST(GearedMotor, PlayMatchesSmallSteps) {
  std::mt19937 random(7);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
  };
  for (int run = 0; run < 20; ++run) {
    const double play = uniform(0, 0.4);
    GearedMotor motor(play);
    double side = 0;
    RigTime now{};
    for (int command = 0; command < 20; ++command) {
      motor.Drive(command % 4 == 3 ? 0 : uniform(-6, 6), uniform(0.01, 0.2), now);
      const RigTime until = now + FromSeconds(uniform(0.02, 0.4));
      for (; now < until; now += std::chrono::microseconds(400)) {
        side = std::clamp(side, motor.Angle(now) - play / 2, motor.Angle(now) + play / 2);
      }
      now = until;
      side = std::clamp(side, motor.Angle(now) - play / 2, motor.Angle(now) + play / 2);
      EXPECT_NEAR(motor.Driven(now), side, 1e-5) << run << " " << command;
    }
  }
}

TEST(GearedMotor, RemembersWhereItWas) {
  GearedMotor motor(0.1);
  motor.Drive(1, 0.05, seconds(1));
  const double angle = motor.Angle(milliseconds(1990)), side = motor.Driven(milliseconds(1990));
  motor.Drive(-2, 0.05, seconds(2));
  EXPECT_EQ(motor.Angle(milliseconds(1990)), angle) << "mid-exposure, before the last command";
  EXPECT_EQ(motor.Driven(milliseconds(1990)), side);
  EXPECT_EQ(motor.Angle({}), 0);
}

}  // namespace
}  // namespace mesorig::plant
