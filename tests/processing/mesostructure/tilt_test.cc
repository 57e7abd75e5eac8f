#include "processing/mesostructure/tilt.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "processing/mesostructure/displacement.h"
#include "tests/processing/mesostructure/synthetic_sweep.h"

namespace mesorig::mesostructure {
namespace {

using ::testing::HasSubstr;

using Fixes = std::vector<std::optional<TiltFix>>;

Fixes Steady(size_t count) {
  Fixes fixes;
  for (size_t k = 0; k < count; ++k)
    fixes.push_back(TiltFix{0.001 * static_cast<double>(k), 1e-12});
  return fixes;
}

TEST(CompleteTilts, BridgesShortGapsOnly) {
  Fixes fixes = Steady(30);
  fixes[0].reset();
  for (const size_t k : {5u, 10u, 11u, 12u, 20u, 21u, 22u, 23u}) fixes[k].reset();
  const Fixes tilts = CompleteTilts(fixes);
  EXPECT_FALSE(tilts[0]);
  for (const size_t k : {5u, 10u, 11u, 12u}) {
    ASSERT_TRUE(tilts[k]) << k;
    EXPECT_NEAR(tilts[k]->tilt_rad, 0.001 * static_cast<double>(k), 1e-12);
    EXPECT_GT(tilts[k]->variance, 1e-9);  // less sure than a fix
  }
  for (const size_t k : {20u, 21u, 22u, 23u}) EXPECT_FALSE(tilts[k]) << k;
}

TEST(CompleteTilts, DropsWhatStandsOffAndSweepsThatTurnBack) {
  Fixes fixes = Steady(20);
  fixes[7]->tilt_rad += 0.0008;
  const Fixes tilts = CompleteTilts(fixes);
  ASSERT_TRUE(tilts[7]);
  EXPECT_NEAR(tilts[7]->tilt_rad, 0.007, 1e-9);  // bridged
  EXPECT_EQ(tilts[6]->tilt_rad, 0.006);
  EXPECT_EQ(tilts[8]->tilt_rad, 0.008);
  Fixes ends = Steady(20);
  ends[0]->tilt_rad -= 0.001, ends[19]->tilt_rad += 0.001;
  EXPECT_FALSE(CompleteTilts(ends)[0] || CompleteTilts(ends)[19]);
  EXPECT_TRUE(CompleteTilts(ends)[1] && CompleteTilts(ends)[18]);
  for (size_t k = 10; k < 20; ++k) fixes[k]->tilt_rad = 0.02 - 0.001 * static_cast<double>(k);
  for (const auto& tilt : CompleteTilts(fixes)) EXPECT_FALSE(tilt);
  EXPECT_TRUE(CompleteTilts({}).empty());
  EXPECT_EQ(CompleteTilts(Fixes(5)).size(), 5u);
  EXPECT_TRUE(CompleteTilts(Steady(1))[0]);
}

// Camera 2 stands at 30 degrees; the laser's pencil at this polar angle and arc.
class OneView : public ::testing::Test {
 protected:
  SweepGeometry Geometry(double mount_theta_deg, double light_arc_deg) {
    rig_.laser->mounts[1].theta_rad = mount_theta_deg * kPi / 180;
    axis_rad_ = {0, light_arc_deg * kPi / 180};
    auto geometry = SweepGeometry::Build(rig_, product_, 40, 2, 1, axis_rad_, region_);
    EXPECT_TRUE(geometry.ok()) << geometry.status();
    return std::move(geometry).value();
  }
  // A stripe of the sheet at this tilt on the turntable, by the product's own geometry.
  StripeImage Stripe(const SweepGeometry& drawn, const SweepGeometry& seen, double tilt_rad) {
    StripeImage image;
    image.width = region_.width, image.height = region_.height;
    image.usable = seen.reference();
    image.noise = 8, image.shot = 1;
    const Vec3 normal = SheetNormal(drawn.laser(), tilt_rad);
    for (int j = 0; j < region_.height; ++j) {
      for (int i = 0; i < region_.width; ++i) {
        const Vec3 p = drawn.OnPlane(drawn.Ray({i + 0.5, j + 0.5}), 0);
        const double s = Dot(normal, p - drawn.laser().source);
        image.value.push_back(static_cast<float>(2000 * std::exp(-0.5 * s * s / 1.04)));
      }
    }
    return image;
  }
  Rig rig_ = DemoRig();
  const Product product_{64, 64, 0.625, 4.2};
  const Region region_{0, 0, 256, 192};
  std::vector<double> axis_rad_;
};

TEST_F(OneView, TheLineTellsTheTilt) {
  const SweepGeometry geometry = Geometry(35, 70);
  for (const double tilt : {-0.01, 0.0, 0.017}) {
    const auto fix = FindTilt(geometry, Stripe(geometry, geometry, tilt));
    ASSERT_TRUE(fix.ok()) << fix.status();
    EXPECT_NEAR(fix->tilt_rad, tilt, 1e-5);  // 6 micrometres on the turntable
    EXPECT_LT(fix->variance, 1e-9);
  }
}

TEST_F(OneView, ALineThatIsNotTheLasersIsRefused) {
  const SweepGeometry geometry = Geometry(35, 70), other = Geometry(35, 75);
  const auto fix = FindTilt(geometry, Stripe(other, geometry, 0));
  EXPECT_EQ(fix.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(Message(fix.status())), HasSubstr("degrees to the laser's axis"));
}

TEST_F(OneView, TheTetrahedronIsFlatWhenTheLaserShinesAlongTheView) {
  EXPECT_NEAR(Geometry(30, 0).TetrahedronWeight(), 0, 1e-12);
  EXPECT_NEAR(Geometry(30, 180).TetrahedronWeight(), std::sin(RadFromDeg(60)), 1e-9);
  // By hand: axis (-1, 0, 0), source towards (0, sin 35, cos 35), camera towards (sin 30, 0, cos
  // 30): the product of the latter two has x = sin 35 cos 30 = 0.496732.
  EXPECT_NEAR(Geometry(35, 90).TetrahedronWeight(), 0.496732, 1e-6);
}

TEST_F(OneView, ASheetAlongTheRaysGivesHolesAndNoNan) {
  for (const double arc : {0.0, 0.001, 3.0}) {
    const SweepGeometry geometry = Geometry(30, arc);
    FrameStack stack(geometry.sample().size(), 40);
    Fixes fixes;
    for (uint32_t k = 0; k < 40; ++k) {
      fixes.push_back(TiltFix{0.0005 * (static_cast<double>(k) - 20), 1e-12});
      for (size_t pixel = 0; pixel < geometry.sample().size(); ++pixel) {
        const double z = (static_cast<double>(k) - 20) / 3;
        stack.Set(pixel, k, static_cast<uint16_t>(64 + 800 * std::exp(-0.5 * z * z)));
      }
    }
    const auto image = ComputeDisplacement(geometry, product_, {64, 5, 4000, 8}, 2.4, stack, fixes);
    ASSERT_TRUE(image.ok()) << image.status();
    EXPECT_GT(image->figures.pixels, 1000u);
    for (size_t k = 0; k < 64 * 64; ++k) {
      ASSERT_TRUE(std::isfinite(image->mdf.Distance(0)[k]));
      ASSERT_LT(image->mdf.Confidence(0)[k], 0.05f);
    }
    EXPECT_TRUE(arc > 0 || image->figures.texels == 0);
    stack = FrameStack(geometry.sample().size(), 40);  // nothing has come
    const auto none = ComputeDisplacement(geometry, product_, {64, 5, 4000, 8}, 2.4, stack, fixes);
    ASSERT_TRUE(none.ok());
    EXPECT_EQ(none->figures.peaks, 0u);
    EXPECT_FALSE(
        ComputeDisplacement(geometry, product_, {64, 5, 4000, 8}, 2.4, stack, Fixes(40)).ok());
  }
}

TEST_F(OneView, CamerasAndMountsBelowThePlaneAreRefused) {
  rig_.laser->mounts[1].theta_rad = kPi / 2;
  axis_rad_ = {0, 0};
  const auto low = SweepGeometry::Build(rig_, product_, 40, 2, 1, axis_rad_, region_);
  EXPECT_EQ(low.status().code(), absl::StatusCode::kFailedPrecondition);
  rig_.laser->mounts[1].theta_rad = 0.5;
  const Product high{64, 64, 0.625, 900};
  EXPECT_FALSE(SweepGeometry::Build(rig_, high, 40, 2, 1, axis_rad_, region_).ok());
}

}  // namespace
}  // namespace mesorig::mesostructure
