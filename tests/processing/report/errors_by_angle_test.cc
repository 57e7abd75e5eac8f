#include "processing/report/errors_by_angle.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mesorig::report {
namespace {

btf::SampledBtf Constant(float value) {
  btf::BtfHeader header;
  header.width = 3, header.height = 2, header.pitch_mm = 1;
  for (const double theta : {0.0, 30.0, 60.0}) {
    for (const double phi : {0.0, 120.0, 240.0}) {
      if (theta > 0 || phi == 0) header.views.push_back(DirectionFromAngles(RadFromDeg(theta), RadFromDeg(phi)));
    }
  }
  header.lights = {DirectionFromAngles(RadFromDeg(20), 0), DirectionFromAngles(RadFromDeg(70), 0)};
  btf::SampledBtf btf(header);
  for (int v = 0; v < header.view_count(); ++v) {
    for (int l = 0; l < header.light_count(); ++l) {
      btf.SetPresent(v, l, true);
      for (float& x : btf.MutableImage(v, l)) x = value;
    }
  }
  return btf;
}

// Only views at 60 degrees under the light at 70 differ, by 0.1 of 0.5: 3 of 6 pairs of that ring
// of views, 3 of 7 pairs of that light.
TEST(ErrorsByAngle, FindsTheRingThatIsWrong) {
  btf::SampledBtf a = Constant(0.5f);
  for (int v = 4; v < 7; ++v) {
    for (float& x : a.MutableImage(v, 1)) x = 0.6f;
  }
  const auto result = ErrorsByAngle(a, Constant(0.5f));
  ASSERT_TRUE(result.ok()) << result.status();
  ASSERT_EQ(result->by_view_theta.size(), 3u);
  ASSERT_EQ(result->by_light_theta.size(), 2u);
  EXPECT_NEAR(result->by_view_theta[1].theta_deg, 30, 1e-9);
  EXPECT_EQ(result->by_view_theta[1].rel_error, 0);
  EXPECT_EQ(result->by_view_theta[1].psnr_db, btf::kMaxPsnrDb);
  EXPECT_NEAR(result->by_view_theta[2].rel_error, 0.2 * std::sqrt(0.5), 1e-6);
  EXPECT_EQ(result->by_view_theta[2].pairs, 6u);
  EXPECT_NEAR(result->by_light_theta[1].rel_error, 0.2 * std::sqrt(3.0 / 7), 1e-6);
  EXPECT_NEAR(result->by_light_theta[1].rmse, 0.1 * std::sqrt(3.0 / 7), 1e-7);
}

TEST(ErrorsByAngle, AbsentPairsDoNotCount) {
  btf::SampledBtf a = Constant(0.5f);
  for (int v = 4; v < 7; ++v) a.SetPresent(v, 1, false), a.SetPresent(v, 0, false);
  const auto result = ErrorsByAngle(a, Constant(0.5f));
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(result->by_view_theta.size(), 2u);
}

TEST(ErrorsByAngle, RefusesWhatCannotBeCompared) {
  btf::SampledBtf a = Constant(0.5f);
  a.MutableImage(2, 0)[1] = std::nanf("");
  EXPECT_TRUE(absl::IsInvalidArgument(ErrorsByAngle(a, Constant(0.5f)).status()));
}

}  // namespace
}  // namespace mesorig::report
