#include "processing/btf/btf_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <limits>

#include "protocol/base/digest.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::btf {
namespace {

using ::testing::HasSubstr;

BtfHeader Header() {
  BtfHeader header = SmallHeader(9, 5, RingDirections(2, 4, 60), RingDirections(1, 5, 50));
  for (size_t i = 0; i < header.views.size(); ++i) {
    header.view_positions_mm.push_back(500 * header.views[i]);
  }
  header.calibrated = false;
  header.primaries = "rec709";
  header.mask.assign(header.texel_count(), 1);
  header.mask[7] = 0;
  return header;
}

void ExpectSameHeader(const BtfHeader& a, const BtfHeader& b) {
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  EXPECT_EQ(a.pitch_mm, b.pitch_mm);
  EXPECT_EQ(a.h_ref_mm, b.h_ref_mm);
  EXPECT_EQ(a.cosine_included, b.cosine_included);
  EXPECT_EQ(a.calibrated, b.calibrated);
  EXPECT_EQ(a.primaries, b.primaries);
  EXPECT_EQ(a.provenance_json, b.provenance_json);
  EXPECT_EQ(a.mask, b.mask);
  ASSERT_EQ(a.views.size(), b.views.size());
  ASSERT_EQ(a.lights.size(), b.lights.size());
  ASSERT_EQ(a.view_positions_mm.size(), b.view_positions_mm.size());
  for (size_t i = 0; i < a.views.size(); ++i) {
    EXPECT_LT(Norm(a.views[i] - b.views[i]), 1e-6);
    EXPECT_LT(Norm(a.view_positions_mm[i] - b.view_positions_mm[i]), 1e-3);
  }
}

TEST(BtfFile, RoundTrip) {
  TemporaryFolder folder;
  SampledBtf btf = SyntheticBtf(Header(), 0.3);
  for (int l = 0; l < 6; ++l) btf.SetPresent(2, l, false);  // a view without any light
  ASSERT_TRUE(WriteSampledBtf(btf, folder / "a.btf.exr").ok());
  const auto read = ReadSampledBtf(folder / "a.btf.exr");
  ASSERT_TRUE(read.ok()) << read.status();
  ExpectSameHeader(btf.header(), read->header());
  for (int v = 0; v < 9; ++v) {
    for (int l = 0; l < 6; ++l) {
      ASSERT_EQ(btf.Present(v, l), read->Present(v, l));
      if (!btf.Present(v, l)) continue;
      for (size_t i = 0; i < btf.image_size(); ++i) {
        EXPECT_NEAR(read->Image(v, l)[i], btf.Image(v, l)[i], btf.Image(v, l)[i] * 5e-4 + 1e-7);
      }
    }
  }
  // Half has been rounded to once: a further trip changes no byte.
  ASSERT_TRUE(WriteSampledBtf(*read, folder / "b.btf.exr").ok());
  ASSERT_TRUE(WriteSampledBtf(*ReadSampledBtf(folder / "b.btf.exr"), folder / "c.btf.exr").ok());
  EXPECT_EQ(Sha256(*ReadFile(folder / "b.btf.exr")), Sha256(*ReadFile(folder / "c.btf.exr")));
}

TEST(BtfFile, InfoComesFromPartZero) {
  TemporaryFolder folder;
  ASSERT_TRUE(WriteSampledBtf(SyntheticBtf(Header(), 0.3), folder / "a.btf.exr").ok());
  const auto info = ReadBtfInfo(folder / "a.btf.exr");
  ASSERT_TRUE(info.ok()) << info.status();
  ExpectSameHeader(Header(), info->header);
  EXPECT_EQ(info->codec, "raw");
  EXPECT_EQ(info->file_bytes, std::filesystem::file_size(folder / "a.btf.exr"));
  EXPECT_EQ(info->present.size(), 54u);
}

TEST(BtfFile, ValueScaleKeepsHugeAndTinyValues) {
  TemporaryFolder folder;
  for (const float factor : {1e30f, 1e7f, 1.0f, 1e-6f, 1e-30f}) {
    SampledBtf btf = SyntheticBtf(Header());
    for (int v = 0; v < 9; ++v) {
      for (int l = 0; l < 6; ++l) {
        for (float& x : btf.MutableImage(v, l)) x *= factor;
      }
    }
    ASSERT_TRUE(WriteSampledBtf(btf, folder / "a.btf.exr").ok());
    const auto read = ReadSampledBtf(folder / "a.btf.exr");
    ASSERT_TRUE(read.ok()) << read.status();
    for (size_t i = 0; i < btf.image_size(); ++i) {
      EXPECT_NEAR(read->Image(3, 2)[i] / factor, btf.Image(3, 2)[i] / factor, 5e-4);
    }
    EXPECT_EQ(ReadBtfInfo(folder / "a.btf.exr")->value_scale == 1.0, factor == 1.0f);
  }
}

TEST(BtfFile, RefusesNanAndLeavesNothingBehind) {
  TemporaryFolder folder;
  SampledBtf btf = SyntheticBtf(Header());
  btf.MutableImage(1, 1)[4] = std::numeric_limits<float>::quiet_NaN();
  const Status status = WriteSampledBtf(btf, folder / "a.btf.exr");
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  btf.MutableImage(1, 1)[4] = std::numeric_limits<float>::infinity();
  EXPECT_FALSE(WriteSampledBtf(btf, folder / "a.btf.exr").ok());
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  EXPECT_FALSE(WriteSampledBtf(SyntheticBtf(Header()), folder / "no/such/a.btf.exr").ok());
}

TEST(BtfFile, CodedRoundTrip) {
  TemporaryFolder folder;
  const auto raw = SyntheticBtf(Header());
  BtfFileInfo info;
  info.header = raw.header();
  info.codec = "test";
  info.codec_version = 3;
  info.codec_options_json = R"({"terms":2})";
  info.present.assign(54, 1);
  Plane half{"half_part", 3, 2, {"a", "b"}, true, {}};
  for (int i = 0; i < 12; ++i) half.values.push_back(static_cast<float>(i) / 4);
  Plane full{"zz", 2, 1, {"w"}, false, {1e-30f, 0.1f}};
  ASSERT_TRUE(WriteCodedBtf(info, {full, half}, raw.Image(0, 0), folder / "c.btf.exr").ok());
  const auto read = ReadCodedBtf(folder / "c.btf.exr");
  ASSERT_TRUE(read.ok()) << read.status();
  ExpectSameHeader(info.header, read->info.header);
  EXPECT_EQ(read->info.codec, "test");
  EXPECT_EQ(read->info.codec_version, 3);
  ASSERT_EQ(read->planes.size(), 2u);
  EXPECT_EQ(read->planes.at("half_part").values, half.values);
  EXPECT_EQ(read->planes.at("half_part").channels, half.channels);
  EXPECT_TRUE(read->planes.at("half_part").half);
  EXPECT_EQ(read->planes.at("zz").values, full.values);
  EXPECT_THAT(std::string(Message(ReadSampledBtf(folder / "c.btf.exr").status())),
              HasSubstr("codec test"));
}

TEST(BtfFile, GarbageIsRefusedByName) {
  TemporaryFolder folder;
  const auto message = [&](std::string_view bytes) {
    EXPECT_TRUE(WriteFileAtomically(folder / "g", bytes).ok());
    const Status status = ReadBtfInfo(folder / "g").status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(Message(status)), HasSubstr((folder / "g").string()));
    EXPECT_EQ(Message(status).find('\n'), std::string::npos);
    return std::string(Message(status));
  };
  EXPECT_THAT(message(""), HasSubstr("not an OpenEXR file"));
  EXPECT_THAT(message("hello world, this is no picture"), HasSubstr("not an OpenEXR file"));
  EXPECT_THAT(message(std::string("\x76\x2f\x31\x01\x02\0\0\0", 8)), HasSubstr("header"));
  EXPECT_EQ(ReadBtfInfo(folder / "absent").status().code(), absl::StatusCode::kNotFound);
  EXPECT_FALSE(ReadBtfInfo(folder.path()).ok());
}

TEST(BtfFile, NewerMajorVersionIsRefused) {
  TemporaryFolder folder;
  ASSERT_TRUE(WriteSampledBtf(SyntheticBtf(Header()), folder / "a").ok());
  std::string bytes = *ReadFile(folder / "a");
  const size_t at = bytes.find("formatMajor");
  ASSERT_NE(at, std::string::npos);
  bytes[at + 12 + 4 + 4] = 9;  // name\0 "int"\0 size, value
  ASSERT_TRUE(WriteFileAtomically(folder / "b", bytes).ok());
  EXPECT_THAT(std::string(Message(ReadBtfInfo(folder / "b").status())),
              HasSubstr("format version 9"));
}

TEST(BtfFile, ExrheaderReadsIt) {
  if (std::system("command -v exrheader >/dev/null") != 0) {
    GTEST_SKIP() << "exrheader is not installed";
  }
  TemporaryFolder folder;
  ASSERT_TRUE(WriteSampledBtf(SyntheticBtf(Header()), folder / "a.exr").ok());
  const std::string command = "exrheader " + (folder / "a.exr").string();
  std::FILE* pipe = ::popen(command.c_str(), "r");
  ASSERT_NE(pipe, nullptr);
  std::string text;
  char buffer[4096];
  for (size_t n; (n = std::fread(buffer, 1, sizeof(buffer), pipe)) > 0;) text.append(buffer, n);
  EXPECT_EQ(::pclose(pipe), 0);
  EXPECT_THAT(text, HasSubstr("mesorig-btf"));
  EXPECT_THAT(text, HasSubstr("V008"));
  EXPECT_THAT(text, HasSubstr("L005.R"));
}

TEST(PreviewPair, PrefersTheZenithAndOnlyWhatIsPresent) {
  const BtfHeader header = Header();
  std::vector<uint8_t> present(54, 1);
  EXPECT_EQ(PreviewPair(header, present).first, 0);
  EXPECT_NE(PreviewPair(header, present).second, 0);
  for (size_t l = 0; l < 6; ++l) present[l] = 0;
  EXPECT_NE(PreviewPair(header, present).first, 0);
}

TEST(BtfFile, VariancesAreKept) {
  TemporaryFolder folder;
  SampledBtf btf =
      SyntheticBtf(SmallHeader(5, 4, RingDirections(1, 3, 40), RingDirections(1, 4, 40)), 0.2);
  btf.AddVariance();
  for (int v = 0; v < 4; ++v) {
    for (int l = 0; l < 5; ++l) {
      for (size_t i = 0; i < 20; ++i) {
        btf.MutableVariance(v, l)[i] = 1e-7f * static_cast<float>(1 + i + 20 * v + 80 * l);
      }
    }
  }
  ASSERT_TRUE(WriteSampledBtf(btf, folder / "a").ok());
  const auto read = ReadSampledBtf(folder / "a");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_TRUE(read->has_variance());
  for (int v = 0; v < 4; ++v) {
    for (int l = 0; l < 5; ++l) {
      if (!btf.Present(v, l)) continue;
      EXPECT_TRUE(std::ranges::equal(read->Variance(v, l), btf.Variance(v, l)));
      EXPECT_NEAR(read->Image(v, l)[7], btf.Image(v, l)[7], 1e-3);
    }
  }
  EXPECT_FALSE(ReadSampledBtf(folder / "a")->Variance(0, 0).empty());
  const auto [view, light] = PreviewPair(btf.header(), ReadBtfInfo(folder / "a")->present);
  btf.MutableVariance(view, light)[3] = -1;
  ASSERT_TRUE(WriteSampledBtf(btf, folder / "b").ok());
  const Status refused = ReadSampledBtf(folder / "b").status();
  EXPECT_NE(Message(refused).find("holds a variance of -1"), std::string_view::npos) << refused;
}

}  // namespace
}  // namespace mesorig::btf
