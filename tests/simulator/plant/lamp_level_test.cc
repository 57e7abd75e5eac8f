#include "simulator/plant/lamp_level.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mesorig::plant {
namespace {

TEST(LampLevel, RisesAsAFirstOrderLagAndBecomesSteady) {
  LampLevel lamp(0.1, 0.6);
  EXPECT_EQ(lamp.At(5), 0);
  lamp.Set(1, 10);
  EXPECT_EQ(lamp.At(10), 0);
  EXPECT_NEAR(lamp.At(10.1), 1 - std::exp(-1), 1e-12);
  EXPECT_LT(lamp.At(10.59), 1);
  EXPECT_EQ(lamp.At(10.6), 1);
  EXPECT_DOUBLE_EQ(lamp.SteadyAt(), 10.6);
}

TEST(LampLevel, ASecondCommandStartsFromWhereTheFilamentIs) {
  LampLevel lamp(0.1, 0.6);
  lamp.Set(1, 0);
  lamp.Set(0, 0.1);
  EXPECT_NEAR(lamp.At(0.1), 1 - std::exp(-1), 1e-12);
  EXPECT_NEAR(lamp.At(0.2), (1 - std::exp(-1)) * std::exp(-1), 1e-12);
  EXPECT_EQ(lamp.At(0.7), 0);
}

TEST(LampLevel, RepeatedCommandsChangeNothing) {
  LampLevel lamp(0.1, 0.6);
  lamp.Set(1, 0);
  lamp.Set(1, 0.3);
  EXPECT_NEAR(lamp.At(0.3), 1 - std::exp(-3), 1e-12);
  EXPECT_EQ(lamp.At(0.6), 1);
}

TEST(LampLevel, MeanIsTheIntegral) {
  LampLevel lamp(0.08, 0.6);
  lamp.Set(1, 0);
  for (auto [from, to] : {std::pair{0.0, 0.05}, {0.02, 0.9}, {-0.1, 0.3}, {-0.2, -0.1}, {0.55, 0.65}, {0.7, 0.8}}) {
    double sum = 0;
    const int n = 200000;
    for (int i = 0; i < n; ++i) sum += lamp.At(from + (to - from) * (i + 0.5) / n);
    EXPECT_NEAR(lamp.Mean(from, to), sum / n, 1e-6) << from;
  }
  EXPECT_EQ(lamp.Mean(0.6, 0.7), 1);
  EXPECT_EQ(lamp.Mean(0.04, 0.04), lamp.At(0.04));
}

TEST(LampLevel, NoLagFollowsAtOnce) {
  LampLevel lamp(0, 0);
  lamp.Set(0.5, 1);
  EXPECT_EQ(lamp.At(1), 0.5);
  EXPECT_EQ(lamp.Mean(1, 2), 0.5);
}

}  // namespace
}  // namespace mesorig::plant
