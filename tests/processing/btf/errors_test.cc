#include "processing/btf/errors.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/processing/btf/synthetic.h"

namespace mesorig::btf {
namespace {

SampledBtf Constant(float value) {
  SampledBtf btf(SmallHeader(2, 2, {{0, 0, 1}}, {{0, 0, 1}, {0.6, 0, 0.8}}));
  for (int l = 0; l < 2; ++l) {
    btf.SetPresent(0, l, true);
    for (float& x : btf.MutableImage(0, l)) x = value;
  }
  return btf;
}

TEST(CompareBtf, FiguresByHand) {
  const auto errors = CompareBtf(Constant(0.22f), Constant(0.2f));
  ASSERT_TRUE(errors.ok());
  EXPECT_NEAR(errors->rel_error, 0.1, 1e-6);
  EXPECT_NEAR(errors->rmse, 0.02, 1e-7);
  EXPECT_NEAR(errors->psnr_db, 20 * std::log10(1 / kPi / 0.02), 1e-4);
  EXPECT_NEAR(errors->max_abs, 0.02, 1e-7);
  EXPECT_EQ(errors->samples, 24u);
  EXPECT_EQ(errors->pairs, 2u);
}

TEST(CompareBtf, EqualDataReachesTheCap) {
  const auto errors = CompareBtf(Constant(0.2f), Constant(0.2f));
  ASSERT_TRUE(errors.ok());
  EXPECT_EQ(errors->rel_error, 0);
  EXPECT_EQ(errors->psnr_db, kMaxPsnrDb);
}

TEST(CompareBtf, AbsentPairsDoNotCount) {
  SampledBtf a = Constant(0.2f), b = Constant(0.2f);
  for (float& x : a.MutableImage(0, 1)) x = 9;
  b.SetPresent(0, 1, false);
  const auto errors = CompareBtf(a, b);
  ASSERT_TRUE(errors.ok());
  EXPECT_EQ(errors->rel_error, 0);
  EXPECT_EQ(errors->pairs, 1u);
}

TEST(CompareBtf, MaskAndUncalibratedPeak) {
  SampledBtf a = Constant(0.5f), b = Constant(0.5f);
  b.mutable_header().mask = {0, 1, 1, 1};
  b.mutable_header().calibrated = false;
  for (int l = 0; l < 2; ++l) {
    a.MutableImage(0, l)[0] = 7;  // outside the mask
    for (size_t i = 3; i < 12; ++i) a.MutableImage(0, l)[i] = 0.6f;
  }
  const auto errors = CompareBtf(a, b);
  ASSERT_TRUE(errors.ok());
  EXPECT_NEAR(errors->psnr_db, 20, 1e-4);  // peak 1, rmse 0.1
}

TEST(CompareBtf, Refuses) {
  SampledBtf other(SmallHeader(2, 3, {{0, 0, 1}}, {{0, 0, 1}, {0.6, 0, 0.8}}));
  EXPECT_FALSE(CompareBtf(other, Constant(1)).ok());
  SampledBtf turned = Constant(1);
  turned.mutable_header().lights[1] = {0.8, 0, 0.6};
  EXPECT_FALSE(CompareBtf(turned, Constant(1)).ok());
  EXPECT_FALSE(CompareBtf(Constant(1), Constant(0)).ok());  // relative to nothing
  SampledBtf nan = Constant(1);
  nan.MutableImage(0, 0)[5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(CompareBtf(nan, Constant(1)).ok());
  SampledBtf absent = Constant(1);
  absent.SetPresent(0, 0, false);
  absent.SetPresent(0, 1, false);
  EXPECT_FALSE(CompareBtf(absent, Constant(1)).ok());
}

}  // namespace
}  // namespace mesorig::btf
