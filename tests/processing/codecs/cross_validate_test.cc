#include "processing/codecs/cross_validate.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "processing/exchange/importer.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::codecs {
namespace {

btf::SampledBtf Lambert() {
  btf::BtfHeader header = btf::SmallHeader(6, 6, {{0, 0, 1}}, btf::RingDirections(2, 6, 39));
  header.calibrated = false;
  btf::SampledBtf btf(header);
  for (int l = 0; l < header.light_count(); ++l) {
    btf.SetPresent(0, l, true);
    auto image = btf.MutableImage(0, l);
    for (size_t i = 0; i < image.size(); ++i) {
      const Vec3 n = Normalized({0.2 * std::sin(static_cast<double>(i / 3)), 0.1, 1});
      image[i] = static_cast<float>(0.6 * Dot(n, header.lights[static_cast<size_t>(l)]));
    }
  }
  return btf;
}

TEST(CrossValidate, LambertPredictsLambert) {
  btf::SampledBtf btf = Lambert();
  const auto result = CrossValidate(btf, **FindEncoder("rf-ptm"), {});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->lights.size(), 13u);
  EXPECT_GT(result->lambert_psnr_db, 100);
  EXPECT_GT(result->psnr_db, 35);
  EXPECT_EQ(btf.present_count(), 13u);  // as it was
}

TEST(CrossValidate, TheHeldOutLightIsNotSeen) {
  btf::SampledBtf btf = Lambert();
  for (float& x : btf.MutableImage(0, 5)) x = 0.05f;
  const auto result = CrossValidate(btf, **FindEncoder("rf-ptm"), {});
  ASSERT_TRUE(result.ok());
  EXPECT_LT(result->lights[5].psnr_db, 10);
}

TEST(CrossValidate, Refuses) {
  btf::SampledBtf btf = Lambert();
  EXPECT_EQ(CrossValidate(btf, **FindEncoder("view-svd"), {}).status().code(),
            absl::StatusCode::kUnimplemented);
  EXPECT_EQ(btf.present_count(), 13u);
  btf::SampledBtf few = btf::SyntheticBtf(
      btf::SmallHeader(2, 2, {{0, 0, 1}}, btf::RingDirections(1, 2, 30)));
  EXPECT_EQ(CrossValidate(few, **FindEncoder("rf-ptm"), {}).status().code(),
            absl::StatusCode::kInvalidArgument);
}

class RealPhotographs : public ::testing::TestWithParam<const char*> {};

TEST_P(RealPhotographs, AreRelitBetterThanByLambert) {
  const auto folder = std::filesystem::path(MESORIG_SOURCE_DIR).parent_path() / "shared" / "data" /
                      "multi_light" / GetParam();
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is absent";
  auto btf = (*exchange::FindImporter("multi-light"))->Import(folder);
  ASSERT_TRUE(btf.ok()) << btf.status();
  const auto result = CrossValidate(*btf, **FindEncoder("rf-ptm"), {});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_GT(result->psnr_db, result->lambert_psnr_db);
}
INSTANTIATE_TEST_SUITE_P(MultiLight, RealPhotographs, ::testing::Values("cat", "owl"));

}  // namespace
}  // namespace mesorig::codecs
