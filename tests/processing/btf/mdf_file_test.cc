#include "processing/btf/mdf_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <limits>

#include "processing/btf/btf_file.h"
#include "processing/btf/file_kind.h"
#include "protocol/base/digest.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::btf {
namespace {

using ::testing::HasSubstr;

Mdf SmallMdf() {
  MdfHeader header;
  header.width = 7, header.height = 5;
  header.pitch_mm = 0.5, header.h_ref_mm = 4.2;
  header.views = RingDirections(2, 3, 60);
  for (const Vec3& v : header.views) header.view_positions_mm.push_back(800 * v);
  header.calibrated = false;
  header.provenance_json = R"({"made_by":"test"})";
  Mdf mdf(header);
  for (int v = 0; v < header.view_count(); ++v) {
    for (size_t i = 0; i < header.texel_count(); ++i) {
      mdf.MutableDistance(v)[i] =
          0.1f * static_cast<float>(i) + 1.0f / 3.0f + static_cast<float>(v);
      mdf.MutableConfidence(v)[i] = i % 3 == 0 ? 0.0f : 0.25f * static_cast<float>(i);
    }
  }
  return mdf;
}

TEST(MdfFile, RoundTripIsExactInDistance) {
  TemporaryFolder folder;
  const Mdf mdf = SmallMdf();
  ASSERT_TRUE(WriteMdf(mdf, folder / "a").ok());
  const auto read = ReadMdf(folder / "a");
  ASSERT_TRUE(read.ok()) << read.status();
  const MdfHeader &a = mdf.header(), &b = read->header();
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  EXPECT_EQ(a.pitch_mm, b.pitch_mm);
  EXPECT_EQ(a.h_ref_mm, b.h_ref_mm);
  EXPECT_EQ(a.calibrated, b.calibrated);
  EXPECT_EQ(a.provenance_json, b.provenance_json);
  ASSERT_EQ(a.views.size(), b.views.size());
  ASSERT_EQ(b.view_positions_mm.size(), b.views.size());
  for (size_t v = 0; v < a.views.size(); ++v) {
    EXPECT_LT(Norm(a.views[v] - b.views[v]), 1e-6);
    EXPECT_LT(Norm(a.view_positions_mm[v] - b.view_positions_mm[v]), 1e-3);
    for (size_t i = 0; i < a.texel_count(); ++i) {
      EXPECT_EQ(mdf.Distance(static_cast<int>(v))[i], read->Distance(static_cast<int>(v))[i]);
      EXPECT_EQ(mdf.Confidence(static_cast<int>(v))[i], read->Confidence(static_cast<int>(v))[i]);
    }
  }
  ASSERT_TRUE(WriteMdf(*read, folder / "b").ok());
  EXPECT_EQ(Sha256(*ReadFile(folder / "a")), Sha256(*ReadFile(folder / "b")));
}

TEST(MdfFile, InfoComesFromPartZero) {
  TemporaryFolder folder;
  ASSERT_TRUE(WriteMdf(SmallMdf(), folder / "a").ok());
  const auto info = ReadMdfInfo(folder / "a");
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->header.views.size(), 7u);
  EXPECT_EQ(info->file_bytes, std::filesystem::file_size(folder / "a"));
}

TEST(MdfFile, ValuesThatAreNoDistanceOrConfidenceAreRefused) {
  TemporaryFolder folder;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  for (const float bad : {nan, infinity, -infinity, -0.001f}) {
    Mdf mdf = SmallMdf();
    mdf.MutableDistance(2)[3] = bad;
    const Status status = WriteMdf(mdf, folder / "a");
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(Message(status)), HasSubstr("view 2 texel 3"));
  }
  for (const float bad : {nan, infinity, -1.0f, 65520.0f}) {
    Mdf mdf = SmallMdf();
    mdf.MutableConfidence(1)[4] = bad;
    EXPECT_EQ(WriteMdf(mdf, folder / "a").code(), absl::StatusCode::kInvalidArgument);
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(MdfFile, HeaderThatIsNoneIsRefused) {
  TemporaryFolder folder;
  const auto written = [&](auto change) {
    Mdf mdf = SmallMdf();
    change(mdf.mutable_header());
    return WriteMdf(mdf, folder / "a");
  };
  EXPECT_FALSE(written([](MdfHeader& h) { h.pitch_mm = 0; }).ok());
  EXPECT_FALSE(written([](MdfHeader& h) { h.h_ref_mm = std::nan(""); }).ok());
  EXPECT_FALSE(written([](MdfHeader& h) { h.views[1] = h.views[0]; }).ok());
  EXPECT_FALSE(written([](MdfHeader& h) { h.views[1] = {1, 0, 0}; }).ok());
  EXPECT_FALSE(written([](MdfHeader& h) { h.provenance_json = "{"; }).ok());
  EXPECT_FALSE(written([](MdfHeader& h) { h.view_positions_mm.pop_back(); }).ok());
}

TEST(MdfFile, KindsAreToldApart) {
  TemporaryFolder folder;
  ASSERT_TRUE(WriteMdf(SmallMdf(), folder / "m").ok());
  const BtfHeader header = SmallHeader(3, 2, RingDirections(1, 3, 40), {{0, 0, 1}});
  ASSERT_TRUE(WriteSampledBtf(SyntheticBtf(header), folder / "b").ok());
  EXPECT_EQ(*ReadFileKind(folder / "m"), FileKind::kMdf);
  EXPECT_EQ(*ReadFileKind(folder / "b"), FileKind::kBtf);
  EXPECT_THAT(std::string(Message(ReadMdf(folder / "b").status())), HasSubstr("is a mesorig-btf"));
  EXPECT_THAT(std::string(Message(ReadBtfInfo(folder / "m").status())),
              HasSubstr("is a mesorig-mdf"));
  EXPECT_EQ(ReadFileKind(folder / "absent").status().code(), absl::StatusCode::kNotFound);
  std::ofstream(folder / "text") << "no picture";
  EXPECT_EQ(ReadFileKind(folder / "text").status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(MdfFile, NewerMajorVersionIsRefused) {
  TemporaryFolder folder;
  ASSERT_TRUE(WriteMdf(SmallMdf(), folder / "a").ok());
  std::string bytes = *ReadFile(folder / "a");
  const size_t at = bytes.find("formatMajor");
  ASSERT_NE(at, std::string::npos);
  bytes[at + 12 + 4 + 4] = 9;  // name\0 "int"\0 size, value
  ASSERT_TRUE(WriteFileAtomically(folder / "b", bytes).ok());
  EXPECT_THAT(std::string(Message(ReadMdf(folder / "b").status())), HasSubstr("format version 9"));
}

}  // namespace
}  // namespace mesorig::btf
