#include "processing/btf/pixel_digest.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "processing/btf/btf_file.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::btf {
namespace {

SampledBtf Small() {
  return SyntheticBtf(SmallHeader(5, 3, RingDirections(1, 4, 50), RingDirections(1, 3, 40)), 0.3);
}

std::string DigestOf(const SampledBtf& btf) {
  const TemporaryFolder folder;
  EXPECT_TRUE(WriteSampledBtf(btf, folder / "a.btf.exr").ok());
  const auto digest = PixelDigest(folder / "a.btf.exr");
  EXPECT_TRUE(digest.ok()) << digest.status();
  return digest.value_or("");
}

TEST(PixelDigest, TellsPixelsAndNotTheirStory) {
  const SampledBtf btf = Small();
  const std::string digest = DigestOf(btf);
  EXPECT_EQ(digest.size(), 32u);
  BtfHeader renamed = btf.header();
  renamed.provenance_json = R"({"session": "another"})";
  EXPECT_EQ(DigestOf(SyntheticBtf(renamed, 0.3)), digest);
}

TEST(PixelDigest, AnAbsentPairIsAnotherMeasurement) {
  SampledBtf btf = Small();
  const std::string digest = DigestOf(btf);
  btf.SetPresent(1, 2, false);
  EXPECT_NE(DigestOf(btf), digest);
  EXPECT_NE(DigestOf(SyntheticBtf(btf.header(), 0.31)), digest);
}

TEST(PixelDigest, RefusesWhatIsNoFileOfOurs) {
  const TemporaryFolder folder;
  EXPECT_TRUE(absl::IsNotFound(PixelDigest(folder / "none").status()));
  ASSERT_TRUE(WriteFileAtomically(folder / "garbage", std::string(300, 'x')).ok());
  EXPECT_THAT(std::string(Message(PixelDigest(folder / "garbage").status())),
              ::testing::HasSubstr("garbage"));
}

}  // namespace
}  // namespace mesorig::btf
