#include "processing/assemble/merged_positions.h"

#include <gtest/gtest.h>

#include <vector>

namespace mesorig::assemble {
namespace {

TEST(MergePositions, NeedsBothAngleAndDistance) {
  const std::vector<Vec3> positions = {{0, 0, 804.5}, {0.3, 0, 804.5}, {1, 0, 804.5}, {0, 0, 806}};
  const MergedPositions merged = MergePositions(positions, {0, 0, 4.5});
  EXPECT_EQ(merged.index_of[0], merged.index_of[1]);
  EXPECT_NE(merged.index_of[0], merged.index_of[2]) << "1 mm and 1.25 mrad away";
  EXPECT_NE(merged.index_of[0], merged.index_of[3]) << "the same direction from 1.5 mm further";
  EXPECT_NEAR(merged.positions_mm[static_cast<size_t>(merged.index_of[0])].x, 0.15, 1e-12);
}

TEST(MergePositions, OrdersByRingThenAzimuth) {
  std::vector<Vec3> positions;
  const auto add = [&](double theta_deg, double phi_deg) {
    positions.push_back(800 * DirectionFromAngles(RadFromDeg(theta_deg), RadFromDeg(phi_deg)));
  };
  add(60, 300), add(30, 60), add(60, -1e-7), add(0, 0), add(60, 120), add(30, 0);
  const MergedPositions merged = MergePositions(positions, {});
  EXPECT_EQ(merged.index_of, (std::vector<int>{5, 2, 3, 0, 4, 1}));
  for (const Vec3& d : merged.directions) EXPECT_NEAR(Norm(d), 1, 1e-12);
}

TEST(MergePositions, OfNothingIsNothing) {
  EXPECT_TRUE(MergePositions({}, {}).directions.empty());
}

}  // namespace
}  // namespace mesorig::assemble
