// Files from outside: whatever bytes stand in them, reading ends with a Status.

#include <gtest/gtest.h>

#include "processing/btf/btf_file.h"
#include "processing/btf/file_kind.h"
#include "processing/btf/mdf_file.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/mutations.h"

namespace mesorig::btf {
namespace {

// What was read holds together, or the refusal says why.
template <typename T>
void ExpectWholeOrRefused(const StatusOr<T>& read, const BtfHeader* header) {
  if (read.ok()) {
    EXPECT_TRUE(CheckHeader(*header).ok()) << CheckHeader(*header);
  } else {
    EXPECT_FALSE(Message(read.status()).empty());
  }
}

// Reads with every entry point.
void ExpectEveryReadWholeOrRefused(const std::filesystem::path& path) {
  const auto info = ReadBtfInfo(path);
  ExpectWholeOrRefused(info, info.ok() ? &info->header : nullptr);
  const auto sampled = ReadSampledBtf(path);
  ExpectWholeOrRefused(sampled, sampled.ok() ? &sampled->header() : nullptr);
  const auto coded = ReadCodedBtf(path);
  ExpectWholeOrRefused(coded, coded.ok() ? &coded->info.header : nullptr);
}

std::string ValidFile(const TemporaryFolder& folder) {
  BtfHeader header = SmallHeader(6, 4, RingDirections(1, 3, 40), RingDirections(1, 2, 40));
  header.mask.assign(header.texel_count(), 1);
  EXPECT_TRUE(WriteSampledBtf(SyntheticBtf(header), folder / "valid").ok());
  return *ReadFile(folder / "valid");
}

TEST(BtfFileMutation, BytesChanged) {
  MutateBytes(ValidFile(TemporaryFolder()), ExpectEveryReadWholeOrRefused);
}

TEST(BtfFileMutation, LengthsChanged) {
  MutateLengths(ValidFile(TemporaryFolder()), ExpectEveryReadWholeOrRefused);
}

TEST(BtfFileMutation, Truncated) {
  Truncate(ValidFile(TemporaryFolder()), [](const std::filesystem::path& path) {
    ExpectEveryReadWholeOrRefused(path);
    EXPECT_FALSE(ReadSampledBtf(path).ok());
  });
}

TEST(BtfFileMutation, PiecesMovedAndRepeated) {
  MovePieces(ValidFile(TemporaryFolder()), ExpectEveryReadWholeOrRefused);
}

std::string ValidMdfFile(const TemporaryFolder& folder) {
  MdfHeader header;
  header.width = 6, header.height = 4;
  header.pitch_mm = 0.5, header.h_ref_mm = 3;
  header.views = RingDirections(1, 3, 40);
  for (const Vec3& v : header.views) header.view_positions_mm.push_back(500 * v);
  Mdf mdf(header);
  for (int v = 0; v < header.view_count(); ++v) {
    for (float& d : mdf.MutableDistance(v)) d = 1.0f + static_cast<float>(v);
    for (float& c : mdf.MutableConfidence(v)) c = 0.5f;
  }
  EXPECT_TRUE(WriteMdf(mdf, folder / "valid").ok());
  return *ReadFile(folder / "valid");
}

void ExpectMdfWholeOrRefused(const std::filesystem::path& path) {
  const auto kind = ReadFileKind(path);
  EXPECT_EQ(kind.ok(), Message(kind.status()).empty());
  const auto info = ReadMdfInfo(path);
  if (info.ok()) {
    EXPECT_TRUE(CheckMdfHeader(info->header).ok());
  } else {
    EXPECT_FALSE(Message(info.status()).empty());
  }
  const auto mdf = ReadMdf(path);
  if (!mdf.ok()) {
    EXPECT_FALSE(Message(mdf.status()).empty());
    return;
  }
  for (int v = 0; v < mdf->header().view_count(); ++v) {
    for (const float d : mdf->Distance(v)) ASSERT_TRUE(std::isfinite(d) && d >= 0);
    for (const float c : mdf->Confidence(v)) ASSERT_TRUE(std::isfinite(c) && c >= 0);
  }
}

TEST(MdfFileMutation, BytesChanged) {
  MutateBytes(ValidMdfFile(TemporaryFolder()), ExpectMdfWholeOrRefused);
}

TEST(MdfFileMutation, LengthsChanged) {
  MutateLengths(ValidMdfFile(TemporaryFolder()), ExpectMdfWholeOrRefused);
}

TEST(MdfFileMutation, Truncated) {
  Truncate(ValidMdfFile(TemporaryFolder()), [](const std::filesystem::path& path) {
    ExpectMdfWholeOrRefused(path);
    EXPECT_FALSE(ReadMdf(path).ok());
  });
}

TEST(MdfFileMutation, PiecesMovedAndRepeated) {
  MovePieces(ValidMdfFile(TemporaryFolder()), ExpectMdfWholeOrRefused);
}

}  // namespace
}  // namespace mesorig::btf
