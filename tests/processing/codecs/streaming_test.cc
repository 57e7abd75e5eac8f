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

// 2 MB as float.
btf::BtfHeader Header() { return MaskedHeader(40, 30); }

// With variances that differ from sample to sample.
btf::SampledBtf Input(double absent) {
  btf::SampledBtf btf = SyntheticBtf(Header(), absent);
  btf.AddVariance();
  std::mt19937 random(11);
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      if (!btf.Present(v, l)) continue;
      for (float& s : btf.MutableVariance(v, l)) s = 1e-6f * static_cast<float>(1 + random() % 100);
    }
  }
  return btf;
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
  bool has_variance() const override { return source_.has_variance(); }
  Status Variances(int64_t first, int64_t count, std::span<const size_t> pairs,
                   float* out) const override {
    return source_.Variances(first, count, pairs, out);
  }
  int64_t largest() const { return largest_; }

 private:
  const SampleSource& source_;
  mutable std::atomic<int64_t> largest_ = 0;
};

class StreamingCodec : public ::testing::TestWithParam<const Encoder*> {
 protected:
  bool Takes(OptionSet option) const { return (GetParam()->options() & option) != 0; }
  // Few terms and clusters, nothing rounded, small blocks.
  EncodeOptions Options() const {
    EncodeOptions options;
    const int most = GetParam()->max_terms(SyntheticBtf(Header()));
    options.terms = std::min(4, most);
    if (Takes(kQuantisation)) options.quantisation = Quantisation::kFloat;
    if (Takes(kClusters)) options.clusters = 3;
    options.block_bytes = 200000;
    return options;
  }
  // The largest difference of what is decoded, from a file and from memory.
  double Difference(double absent, const EncodeOptions& options) const {
    const TemporaryFolder folder;
    EXPECT_TRUE(btf::WriteSampledBtf(Input(absent), folder / "b").ok());
    const auto btf = btf::ReadSampledBtf(folder / "b");  // as half has it
    auto strips = btf::BtfStrips::Open(folder / "b");
    EXPECT_TRUE(btf.ok() && strips.ok()) << strips.status();
    const FileSource file(*std::move(strips));
    const Watched watched(file);
    const auto streamed = GetParam()->EncodeFrom(watched, options);
    const auto whole = GetParam()->Encode(*btf, options);
    EXPECT_TRUE(streamed.ok() && whole.ok()) << streamed.status() << whole.status();
    EXPECT_LE(watched.largest(), options.block_bytes);
    if (!streamed.ok() || !whole.ok()) return 1e9;
    EXPECT_EQ((*streamed)->info().codec_options_json, (*whole)->info().codec_options_json);
    return btf::CompareBtf(DecodeAll(**streamed), DecodeAll(**whole))->max_abs;
  }
};

TEST_P(StreamingCodec, FileAndMemoryAgree) {
  EncodeOptions options = Options();
  options.solid_angle = Takes(kWeighting);
  EXPECT_LT(Difference(0, options), 1e-5);
  EXPECT_LT(Difference(0.2, options), 1e-5);
}

TEST_P(StreamingCodec, FileAndMemoryAgreeUnderWeightsOfTheValues) {
  if (!Takes(kWeighting)) GTEST_SKIP() << "has no weights";
  for (const Weighting weighting : {Weighting::kLinear, Weighting::kLog, Weighting::kRelative}) {
    if (weighting == Weighting::kLog && !Takes(kLogWeighting)) continue;
    EncodeOptions options = Options();
    options.weighting = weighting;
    options.variance = true;
    EXPECT_LT(Difference(0.2, options), 1e-5) << NameOf(weighting);
  }
}

INSTANTIATE_TEST_SUITE_P(Registry, StreamingCodec, ::testing::ValuesIn(AllEncoders()), CodecOfTest);

TEST(Streaming, StripsAreWhatTheFileHolds) {
  const TemporaryFolder folder;
  ASSERT_TRUE(btf::WriteSampledBtf(Input(0.2), folder / "b").ok());
  const auto btf = btf::ReadSampledBtf(folder / "b");
  const auto strips = btf::BtfStrips::Open(folder / "b");
  ASSERT_TRUE(btf.ok() && strips.ok());
  const std::vector<size_t> pairs = MemorySource(*btf).Pairs();
  std::vector<float> file(3 * pairs.size() * 80), memory(file.size());
  ASSERT_TRUE(strips->Read(7 * 40, 80, pairs, file.data()).ok());
  ASSERT_TRUE(MemorySource(*btf).Columns(7 * 40, 80, pairs, memory.data()).ok());
  EXPECT_EQ(file, memory);
  // Parts of rows.
  ASSERT_TRUE(strips->Read(7 * 40 + 13, 80, pairs, file.data()).ok());
  ASSERT_TRUE(MemorySource(*btf).Columns(7 * 40 + 13, 80, pairs, memory.data()).ok());
  EXPECT_EQ(file, memory);
  EXPECT_EQ(strips->Read(1200 - 79, 80, pairs, file.data()).code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(strips->Read(-1, 1, pairs, file.data()).code(), absl::StatusCode::kInvalidArgument);
  std::vector<float> variances(pairs.size() * 80), expected(variances.size());
  ASSERT_TRUE(strips->has_variance());
  ASSERT_TRUE(strips->ReadVariance(5, 80, pairs, variances.data()).ok());
  ASSERT_TRUE(MemorySource(*btf).Variances(5, 80, pairs, expected.data()).ok());
  EXPECT_EQ(variances, expected);
}

// Of a file and of memory, and of what holds a part of either.
TEST(Streaming, TexelsAreGatheredWhereverTheyStand) {
  const TemporaryFolder folder;
  ASSERT_TRUE(btf::WriteSampledBtf(Input(0.2), folder / "b").ok());
  const auto btf = btf::ReadSampledBtf(folder / "b");
  auto strips = btf::BtfStrips::Open(folder / "b");
  ASSERT_TRUE(btf.ok() && strips.ok());
  const MemorySource memory(*btf);
  const FileSource file(*std::move(strips));
  const std::vector<size_t> pairs = memory.Pairs(), texels = {0, 1, 39, 40, 417, 800, 801, 1199};
  std::vector<float> expected(3 * pairs.size() * texels.size()), gathered(expected.size());
  ASSERT_TRUE(memory.Gather(texels, pairs, expected.data()).ok());
  for (size_t k = 0; k < texels.size(); ++k) {
    EXPECT_EQ(expected[4 * texels.size() + k], btf->Image(static_cast<int>(pairs[1] / 13),
                                                          static_cast<int>(pairs[1] % 13))[3 * texels[k] + 1]);
  }
  ASSERT_TRUE(file.Gather(texels, pairs, gathered.data()).ok());
  EXPECT_EQ(gathered, expected);
  const auto held = Hold(file, {0, 1, 2, 39, 40, 417, 800, 801, 900, 1199}, 20000);
  ASSERT_TRUE(held.ok()) << held.status();
  ASSERT_TRUE((*held)->Gather(texels, pairs, gathered.data()).ok());
  EXPECT_EQ(gathered, expected);
}

TEST(Streaming, DamagedFilesAreRefused) {
  const TemporaryFolder folder;
  const btf::BtfHeader h = btf::SmallHeader(6, 4, RingDirections(1, 3, 40), RingDirections(1, 3, 40));
  btf::SampledBtf btf = SyntheticBtf(h);
  btf.AddVariance();
  ASSERT_TRUE(btf::WriteSampledBtf(btf, folder / "b").ok());
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
    const FileSource source(*std::move(strips));
    EncodeOptions options;
    options.variance = source.has_variance();
    const auto encoded = (*FindEncoder("fmf"))->EncodeFrom(source, options);
    EXPECT_TRUE(encoded.ok() || !Message(encoded.status()).empty());
  }
}

}  // namespace
}  // namespace mesorig::codecs
