#include "processing/btf/mdf_errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "tests/processing/btf/synthetic.h"

namespace mesorig::btf {
namespace {

using ::testing::HasSubstr;

// D(view, texel) everywhere, confidence 1. Views at 0, 30 and 75 degrees.
Mdf MdfOf(const std::function<double(Vec3 view, size_t texel)>& distance) {
  MdfHeader header;
  header.width = 10, header.height = 10;
  header.pitch_mm = 0.5, header.h_ref_mm = 4;
  for (const double theta : {0.0, 30.0, 75.0}) {
    header.views.push_back(DirectionFromAngles(RadFromDeg(theta), 0.3));
  }
  Mdf mdf(header);
  for (int v = 0; v < 3; ++v) {
    for (size_t i = 0; i < 100; ++i) {
      mdf.MutableDistance(v)[i] =
          static_cast<float>(distance(header.views[static_cast<size_t>(v)], i));
      mdf.MutableConfidence(v)[i] = 1;
    }
  }
  return mdf;
}

// 60 texels at z = 1, 40 at z = 3.
double TwoSteps(Vec3 view, size_t texel) { return (4 - (texel < 60 ? 1.0 : 3.0)) / view.z; }

TEST(MdfErrors, KnownFigures) {
  const Mdf truth = MdfOf(TwoSteps);
  Mdf measured = MdfOf([](Vec3 v, size_t i) { return TwoSteps(v, i) + (i % 2 != 0 ? 0.1 : -0.1); });
  for (size_t i = 0; i < 20; ++i) measured.MutableConfidence(1)[i] = 0;
  for (float& d : measured.MutableDistance(2)) d = 1000;  // beyond 60 degrees
  const auto errors = CompareMdf(measured, truth);
  ASSERT_TRUE(errors.ok()) << errors.status();
  EXPECT_NEAR(errors->median_abs_mm, 0.1, 1e-6);
  EXPECT_NEAR(errors->rmse_mm, 0.1, 1e-6);
  EXPECT_NEAR(errors->coverage, 180.0 / 200, 1e-12);
  EXPECT_EQ(errors->texels, 180u);
  EXPECT_EQ(errors->views, 2);
  ASSERT_EQ(errors->by_view_theta.size(), 3u);
  EXPECT_NEAR(errors->by_view_theta[1].theta_deg, 30, 1e-4);
  EXPECT_NEAR(errors->by_view_theta[1].coverage, 0.8, 1e-12);
  EXPECT_GT(errors->by_view_theta[2].median_abs_mm, 900);
  // More than half of the texels lie on z = 1.
  EXPECT_NEAR(errors->best_plane_z_mm, 1, 1e-2);
  EXPECT_NEAR(errors->best_plane_median_abs_mm, 0, 1e-2);
}

TEST(MdfErrors, BestPlaneOfARampLeavesAQuarterOfItsHeight) {
  // z from 0 to 2, seen from above: |error| of the plane in the middle is 0 to 1, median 1/2.
  const Mdf truth =
      MdfOf([](Vec3 v, size_t i) { return (4 - 2 * (static_cast<double>(i) + 0.5) / 100) / v.z; });
  const auto errors = CompareMdf(truth, truth, RadFromDeg(10));
  ASSERT_TRUE(errors.ok()) << errors.status();
  EXPECT_EQ(errors->median_abs_mm, 0);
  EXPECT_NEAR(errors->best_plane_median_abs_mm, 0.5, 0.02);
  EXPECT_NEAR(errors->best_plane_z_mm, 1, 0.52);  // flat: any height within the ramp's middle half
}

TEST(MdfErrors, FlatTruthIsAPlane) {
  const Mdf truth = MdfOf([](Vec3 v, size_t) { return 2.5 / v.z; });
  const auto errors = CompareMdf(truth, truth);
  ASSERT_TRUE(errors.ok()) << errors.status();
  EXPECT_NEAR(errors->best_plane_z_mm, 1.5, 1e-4);
  EXPECT_NEAR(errors->best_plane_median_abs_mm, 0, 1e-4);
}

TEST(MdfErrors, WhatCannotBeComparedIsRefused) {
  const Mdf truth = MdfOf(TwoSteps);
  const auto message = [&](const std::function<void(Mdf&)>& change, double limit = kMdfThetaLimit) {
    Mdf mdf = truth;
    change(mdf);
    const auto errors = CompareMdf(mdf, truth, limit);
    EXPECT_EQ(errors.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(Message(errors.status()));
  };
  EXPECT_THAT(message([](Mdf& m) { m.mutable_header().pitch_mm = 0.6; }), HasSubstr("0.6 mm"));
  EXPECT_THAT(message([](Mdf& m) { m.mutable_header().h_ref_mm = 5; }), HasSubstr("5 mm"));
  EXPECT_THAT(message([](Mdf& m) {
                m.mutable_header().views[1] = {0.6, 0, 0.8};
              }),
              HasSubstr("view 1"));
  EXPECT_THAT(message([](Mdf& m) {
                for (int v = 0; v < 3; ++v) std::ranges::fill(m.MutableConfidence(v), 0.0f);
              }),
              HasSubstr("nothing was measured"));
  EXPECT_THAT(message([](Mdf&) {}, -1), HasSubstr("no view"));
  MdfHeader other = truth.header();
  other.views.pop_back();
  EXPECT_FALSE(CompareMdf(Mdf(other), truth).ok());
}

}  // namespace
}  // namespace mesorig::btf
