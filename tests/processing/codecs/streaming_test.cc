// Encoding from a file that is never held whole gives what encoding from memory gives.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <fstream>

#include "processing/btf/errors.h"
#include "processing/codecs/linear/sample_source.h"
#include "tests/processing/btf/synthetic.h"
#include "tests/processing/codecs/encoding.h"

namespace mesorig::codecs {
namespace {

using btf::RingDirections;
using btf::SyntheticBtf;
using btf::TemporaryFolder;

// 40 x 30 texels, 11 x 13 directions: 2 MB as float.
btf::BtfHeader Header() {
  btf::BtfHeader h = btf::SmallHeader(40, 30, RingDirections(2, 5, 60), RingDirections(2, 6, 60));
  h.mask.assign(h.texel_count(), 1);
  h.mask[3] = 0;
  return h;
}

// Counts what is asked for at a time.
class Watched final : public SampleSource {
 public:
  explicit Watched(const SampleSource& source) : source_(source) {}
  const btf::BtfHeader& header() const override { return source_.header(); }
  const std::vector<uint8_t>& present() const override { return source_.present(); }
  int64_t granule() const override { return source_.granule(); }
  Status Columns(int64_t first, int64_t count, std::span<const size_t> pairs,
                 float* out) const override {
    const int64_t bytes = 12 * count * static_cast<int64_t>(pairs.size());
    for (int64_t seen = largest_; seen < bytes && !largest_.compare_exchange_weak(seen, bytes);) {
    }
    return source_.Columns(first, count, pairs, out);
  }
  int64_t largest() const { return largest_; }

 private:
  const SampleSource& source_;
  mutable std::atomic<int64_t> largest_ = 0;
};

class StreamingCodec : public ::testing::TestWithParam<const char*> {};

TEST_P(StreamingCodec, FileAndMemoryAgree) {
  const TemporaryFolder folder;
  for (const double absent : {0.0, 0.2}) {
    ASSERT_TRUE(btf::WriteSampledBtf(SyntheticBtf(Header(), absent), folder / "b").ok());
    const auto btf = btf::ReadSampledBtf(folder / "b");  // as half has it
    auto strips = btf::BtfStrips::Open(folder / "b");
    ASSERT_TRUE(btf.ok() && strips.ok()) << strips.status();
    const FileSource file(*std::move(strips));
    const Watched watched(file);
    const auto encoder = FindEncoder(GetParam());
    ASSERT_TRUE(encoder.ok());
    EncodeOptions options = Terms(4);
    options.solid_angle = true;
    options.block_bytes = 200000;
    const auto streamed = (*encoder)->EncodeFrom(watched, options);
    const auto whole = (*encoder)->Encode(*btf, options);
    ASSERT_TRUE(streamed.ok() && whole.ok()) << streamed.status();
    EXPECT_LE(watched.largest(), options.block_bytes);
    EXPECT_LT(btf::CompareBtf(DecodeAll(**streamed), DecodeAll(**whole))->max_abs, 1e-5);
  }
}

INSTANTIATE_TEST_SUITE_P(Codecs, StreamingCodec, ::testing::Values("fmf", "pvmf", "tucker", "view-svd"),
                         [](const auto& parameter) {
                           const std::string name = parameter.param;
                           return name == "view-svd" ? "view_svd" : name;
                         });

TEST(Streaming, WhatNeedsTheValuesIsRefused) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  const MemorySource source(btf);
  EncodeOptions options;
  options.weighting = Weighting::kRelative;
  EXPECT_EQ((*FindEncoder("fmf"))->EncodeFrom(source, options).status().code(),
            absl::StatusCode::kUnimplemented);
  EXPECT_EQ((*FindEncoder("pcmf"))->EncodeFrom(source, {}).status().code(),
            absl::StatusCode::kUnimplemented);
}

TEST(Streaming, StripsAreWhatTheFileHolds) {
  const TemporaryFolder folder;
  ASSERT_TRUE(btf::WriteSampledBtf(SyntheticBtf(Header(), 0.2), folder / "b").ok());
  const auto btf = btf::ReadSampledBtf(folder / "b");
  const auto strips = btf::BtfStrips::Open(folder / "b");
  ASSERT_TRUE(btf.ok() && strips.ok());
  const std::vector<size_t> pairs = MemorySource(*btf).Pairs();
  std::vector<float> file(3 * pairs.size() * 80), memory(file.size());
  ASSERT_TRUE(strips->Read(7, 2, pairs, file.data()).ok());
  ASSERT_TRUE(MemorySource(*btf).Columns(7 * 40, 80, pairs, memory.data()).ok());
  EXPECT_EQ(file, memory);
  EXPECT_EQ(strips->Read(29, 2, pairs, file.data()).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(strips->Read(-1, 1, pairs, file.data()).code(), absl::StatusCode::kInvalidArgument);
}

TEST(Streaming, DamagedFilesAreRefused) {
  const TemporaryFolder folder;
  const btf::BtfHeader h = btf::SmallHeader(6, 4, RingDirections(1, 3, 40), RingDirections(1, 3, 40));
  ASSERT_TRUE(btf::WriteSampledBtf(SyntheticBtf(h), folder / "b").ok());
  std::ifstream in(folder / "b", std::ios::binary);
  const std::string valid{std::istreambuf_iterator<char>(in), {}};
  std::mt19937 random(6);
  for (int i = 0; i < 400; ++i) {
    std::string bytes = valid;
    bytes[random() % bytes.size()] = static_cast<char>(random());
    if (i % 5 == 0) bytes.resize(random() % bytes.size());
    std::ofstream(folder / "bad", std::ios::binary | std::ios::trunc) << bytes;
    auto strips = btf::BtfStrips::Open(folder / "bad");
    if (!strips.ok()) continue;
    const auto encoded = (*FindEncoder("fmf"))->EncodeFrom(FileSource(*std::move(strips)), {});
    EXPECT_TRUE(encoded.ok() || !Message(encoded.status()).empty());
  }
}

}  // namespace
}  // namespace mesorig::codecs
