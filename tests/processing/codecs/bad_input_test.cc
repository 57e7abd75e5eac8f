// Damaged files and failing writes, for every codec: the part is named, what decodes is finite, an
// older file is never lost.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <fstream>
#include <limits>

#include "processing/codecs/encoder.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"
#include "tests/processing/codecs/encoding.h"

namespace mesorig::codecs {
namespace {

using btf::RingDirections;
using btf::TemporaryFolder;
using ::testing::HasSubstr;

btf::SampledBtf Small() {
  return btf::SyntheticBtf(
      btf::SmallHeader(4, 3, RingDirections(1, 3, 40), RingDirections(1, 3, 40)));
}

// What the file of `encoded` holds.
btf::CodedBtf Coded(const EncodedBtf& encoded) {
  btf::CodedBtf coded;
  coded.info = encoded.info();
  for (const btf::Plane& plane : encoded.Planes()) coded.planes.emplace(plane.name, plane);
  return coded;
}

// Fails to write as the last of its planes cannot be stored.
class Unwritable final : public EncodedBtf {
 public:
  explicit Unwritable(const EncodedBtf& whole) : whole_(whole) {}
  const btf::BtfFileInfo& info() const override { return whole_.info(); }
  void DecodeImage(int v, int l, std::span<float> rgb) const override { whole_.DecodeImage(v, l, rgb); }
  std::array<float, 3> Evaluate(int x, int y, Vec3 v, Vec3 l) const override {
    return whole_.Evaluate(x, y, v, l);
  }
  std::vector<btf::Plane> Planes() const override {
    std::vector<btf::Plane> planes = whole_.Planes();
    planes.back().values.back() = std::numeric_limits<float>::quiet_NaN();
    return planes;
  }

 private:
  const EncodedBtf& whole_;
};

// Files of this process end after so many bytes, as on a full disk.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FullDisk() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  void (*handler_)(int);
  rlimit before_{};
};

class BadInput : public ::testing::TestWithParam<const Encoder*> {
 protected:
  BadInput() : encoded_(GetParam()->Encode(Small(), {}).value()) {}
  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf coded) const {
    return (*FindDecoder(GetParam()->name()))->Decode(std::move(coded));
  }
  const std::unique_ptr<EncodedBtf> encoded_;
};

TEST_P(BadInput, NamesThePartThatIsMissingOrOfAnotherSize) {
  ASSERT_TRUE(Decode(Coded(*encoded_)).ok());
  for (const btf::Plane& plane : encoded_->Planes()) {
    btf::CodedBtf missing = Coded(*encoded_), wider = Coded(*encoded_);
    missing.planes.erase(plane.name);
    EXPECT_FALSE(Decode(std::move(missing)).ok()) << plane.name;
    btf::Plane& wide = wider.planes.at(plane.name);
    wide.width += 1;
    wide.values.resize(static_cast<size_t>(wide.width * wide.height) * wide.channels.size(), 0.5f);
    const auto refused = Decode(std::move(wider));
    ASSERT_FALSE(refused.ok()) << plane.name;
    EXPECT_THAT(std::string(Message(refused.status())), ::testing::AnyOf(HasSubstr(plane.name),
                                                                         HasSubstr("terms")));
  }
}

TEST_P(BadInput, FactorsThatLeaveFloatTogetherAreRefusedOrDecodeToFiniteValues) {
  for (const float huge : {0x1p30f, 0x1p60f, 0x1p100f, std::numeric_limits<float>::max()}) {
    btf::CodedBtf coded = Coded(*encoded_);
    for (auto& [name, plane] : coded.planes) {
      if (!plane.half && !plane.bytes) std::fill(plane.values.begin(), plane.values.end(), huge);
    }
    const auto decoded = Decode(std::move(coded));
    if (!decoded.ok()) {
      EXPECT_THAT(std::string(Message(decoded.status())), HasSubstr("part")) << huge;
      continue;
    }
    std::vector<float> image(3 * 12);
    (*decoded)->DecodeImage(1, 1, image);
    EXPECT_THAT(image, ::testing::Each(::testing::Truly([](float x) { return std::isfinite(x); })));
    const auto shader = (*decoded)->ToShader();
    if (!shader) continue;
    EXPECT_THAT(shader->rgb,
                ::testing::Each(::testing::Truly([](float x) { return std::isfinite(x); })));
  }
}

TEST_P(BadInput, CutAnywhereItIsRefusedWithItsName) {
  TemporaryFolder folder;
  ASSERT_TRUE(WriteEncodedBtf(*encoded_, folder / "whole").ok());
  const std::string whole = *ReadFile(folder / "whole");
  for (size_t n = 0; n < whole.size(); n += 97) {
    std::ofstream(folder / "cut.btf.exr", std::ios::binary | std::ios::trunc)
        .write(whole.data(), static_cast<std::streamsize>(n));
    const auto read = ReadEncodedBtf(folder / "cut.btf.exr");
    ASSERT_FALSE(read.ok()) << n;
    EXPECT_THAT(std::string(Message(read.status())), HasSubstr("cut.btf.exr"));
  }
}

TEST_P(BadInput, AFailingWriteLeavesTheOldFileAndNothingElse) {
  TemporaryFolder folder;
  ASSERT_TRUE(WriteEncodedBtf(*encoded_, folder / "c").ok());
  const std::string before = *ReadFile(folder / "c");
  const Unwritable bad(*encoded_);
  const Status refused = WriteEncodedBtf(bad, folder / "c");
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(Message(refused)), HasSubstr("part " + encoded_->Planes().back().name));
  Status full;
  {
    const FullDisk disk(before.size() / 2);
    full = WriteEncodedBtf(*encoded_, folder / "c");
  }
  EXPECT_TRUE(absl::IsUnavailable(full)) << full;
  EXPECT_TRUE(*ReadFile(folder / "c") == before);  // (not EXPECT_EQ: bytes)
  const auto entries = std::filesystem::directory_iterator(folder.path());
  EXPECT_EQ(std::distance(begin(entries), end(entries)), 1);  // no temporary file stays
}

INSTANTIATE_TEST_SUITE_P(Registry, BadInput, ::testing::ValuesIn(AllEncoders()), CodecOfTest);

// Memory is taken for absent pairs too: a file of some bytes that declares a hundred times a hundred
// of them is refused before anything is allocated.
TEST(DeclaredSizes, AFileThatDeclaresMuchMoreThanItHoldsIsRefused) {
  TemporaryFolder folder;
  btf::SampledBtf btf(btf::SmallHeader(8, 8, RingDirections(2, 30, 60), RingDirections(2, 30, 60)));
  ASSERT_TRUE(btf::WriteSampledBtf(btf, folder / "empty").ok());
  EXPECT_TRUE(btf::ReadSampledBtf(folder / "empty").ok());  // small
  btf = btf::SampledBtf(
      btf::SmallHeader(96, 96, RingDirections(2, 30, 60), RingDirections(2, 30, 60)));
  ASSERT_TRUE(btf::WriteSampledBtf(btf, folder / "empty").ok());
  const Status refused = btf::ReadSampledBtf(folder / "empty").status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(Message(refused)), HasSubstr("declares 0.4 GB of samples"));
}

}  // namespace
}  // namespace mesorig::codecs
