// What every codec owes, over the registry: a new codec is tested without a line here.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <random>

#include "processing/btf/errors.h"
#include "processing/btf/pair_weights.h"
#include "processing/codecs/encoder.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"
#include "tests/processing/codecs/encoding.h"

namespace mesorig::codecs {
namespace {

using btf::RingDirections;
using btf::SyntheticBtf;
using btf::TemporaryFolder;

btf::BtfHeader Header() { return MaskedHeader(7, 5); }

class EveryCodec : public ::testing::TestWithParam<const Encoder*> {
 protected:
  const Encoder& encoder() const { return *GetParam(); }
};

TEST(CodecRegistry, EncodersAndDecodersBelongTogether) {
  ASSERT_EQ(AllEncoders().size(), AllDecoders().size());
  for (const Encoder* encoder : AllEncoders()) {
    const auto decoder = FindDecoder(encoder->name());
    ASSERT_TRUE(decoder.ok());
    EXPECT_FALSE((*decoder)->paper().empty());
    EXPECT_GE((*decoder)->version(), 1);
  }
  EXPECT_THAT(std::string(Message(FindEncoder("nonsense").status())),
              ::testing::HasSubstr("view-svd"));
}

TEST_P(EveryCodec, WrittenAndReadItDecodesToTheSameBits) {
  TemporaryFolder folder;
  for (const double absent : {0.0, 0.2}) {
    const btf::SampledBtf btf = SyntheticBtf(Header(), absent);
    const auto encoded = encoder().Encode(btf, {});
    ASSERT_TRUE(encoded.ok()) << encoded.status();
    ASSERT_TRUE(WriteEncodedBtf(**encoded, folder / "c").ok());
    const auto read = ReadEncodedBtf(folder / "c");
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_EQ((*read)->info().codec, encoder().name());
    EXPECT_EQ((*read)->info().header.mask, btf.header().mask);
    EXPECT_EQ((*read)->info().header.provenance_json, btf.header().provenance_json);
    EXPECT_EQ((*read)->info().header.h_ref_mm, btf.header().h_ref_mm);
    const btf::SampledBtf a = DecodeAll(**encoded), b = DecodeAll(**read);
    EXPECT_EQ(a.present_count(), btf.present_count());
    EXPECT_LT(btf::CompareBtf(b, a)->max_abs, 4e-7);  // directions are stored as float: a few ulps
    const auto any = ReadAnyBtf(folder / "c");
    ASSERT_TRUE(any.ok());
    EXPECT_EQ(btf::CompareBtf(*any, b)->max_abs, 0);
  }
}

TEST_P(EveryCodec, EvaluatesMeasuredPairsAsItDecodesThem) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  const auto encoded = encoder().Encode(btf, {});
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  std::vector<float> image(btf.image_size());
  for (int v = 0; v < btf.header().view_count(); v += 3) {
    for (int l = 0; l < btf.header().light_count(); l += 2) {
      (*encoded)->DecodeImage(v, l, image);
      const auto rgb = (*encoded)->Evaluate(4, 2, btf.header().views[static_cast<size_t>(v)],
                                            btf.header().lights[static_cast<size_t>(l)]);
      const NodeQuery node{4, 2, v, l};
      std::array<float, 3> sample{};
      (*encoded)->DecodeSamples({&node, 1}, {&sample, 1});
      for (size_t c = 0; c < 3; ++c) {
        EXPECT_NEAR(rgb[c], image[3 * (2 * 7 + 4) + c], 1e-4);
        EXPECT_NEAR(sample[c], image[3 * (2 * 7 + 4) + c], 1e-6);
      }
    }
  }
}

TEST_P(EveryCodec, EvaluatesAnyDirectionToSomethingFinite) {
  const auto encoded = encoder().Encode(SyntheticBtf(Header(), 0.3), {});
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  const auto direction = [&] {
    const double x = normal(random), y = normal(random);
    return Normalized({x, y, normal(random)});
  };
  for (int i = 0; i < 500; ++i) {
    const Vec3 v = direction(), l = direction();
    for (const float value : (*encoded)->Evaluate(i % 7, i % 5, v, l)) {
      EXPECT_TRUE(std::isfinite(value));
      if (l.z <= 0) {
        EXPECT_EQ(value, 0);
      }
    }
  }
}

TEST_P(EveryCodec, EvaluatesABatchAsOneByOne) {
  const auto encoded = encoder().Encode(SyntheticBtf(Header(), 0.3), {});
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  std::mt19937 random(8);
  std::normal_distribution<double> normal;
  std::vector<SampleQuery> queries;
  for (int i = 0; i < 333; ++i) {
    queries.push_back({static_cast<int>(random() % 7), static_cast<int>(random() % 5),
                       {normal(random), normal(random), std::abs(normal(random))},
                       {normal(random), normal(random), normal(random)}});
  }
  std::vector<std::array<float, 3>> values(queries.size(), {-1, -1, -1});
  (*encoded)->EvaluateBatch(queries, values);
  for (size_t i = 0; i < queries.size(); ++i) {
    const auto& [x, y, v, l] = queries[i];
    const auto one = (*encoded)->Evaluate(x, y, v, l);
    for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(values[i][c], one[c], 1e-6);
  }
}

// Interpolation by the book, from whole images: nothing of what makes Evaluate fast. Models of the
// light answer between the lights themselves.
TEST_P(EveryCodec, EvaluatesWhatItsImagesSay) {
  const btf::SampledBtf btf = SyntheticBtf(Header(), 0.3);
  const auto encoded = encoder().Encode(btf, {});
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  const btf::SampledBtf images = DecodeAll(**encoded);
  std::vector<float> image(btf.image_size());
  const bool models_light = (*encoded)->PredictImage(0, {0, 0, 1}, image).ok();
  const auto pairs = btf::PairInterpolator::Build((*encoded)->info().header,
                                                  (*encoded)->info().present);
  ASSERT_TRUE(pairs.ok());
  std::mt19937 random(9);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 300; ++i) {
    const Vec3 v = Normalized({normal(random), normal(random), 1.0});
    const Vec3 l = Normalized({normal(random), normal(random), 1.0});
    const size_t texel = random() % images.header().texel_count();
    const btf::PairWeights weights = pairs->Lookup(v, l);
    const auto value = (*encoded)->Evaluate(static_cast<int>(texel % 7),
                                            static_cast<int>(texel / 7), v, l);
    for (size_t c = 0; c < 3; ++c) {
      double sum = 0;
      for (size_t n = 0; n < static_cast<size_t>(weights.count); ++n) {
        sum += weights.weight[n] * images.Image(weights.view[n], weights.light[n])[3 * texel + c];
      }
      EXPECT_TRUE(std::isfinite(value[c]));
      if (!models_light) {
        EXPECT_NEAR(value[c], weights.scale * sum, 1e-6);
      }
    }
  }
}

TEST_P(EveryCodec, LearnsALambertSurface) {
  btf::SampledBtf btf(Header());
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      btf.SetPresent(v, l, true);
      const double z = btf.header().lights[static_cast<size_t>(l)].z;
      for (float& x : btf.MutableImage(v, l)) x = static_cast<float>(0.25 * z);
    }
  }
  const auto encoded = encoder().Encode(btf, {});
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  EXPECT_LT(btf::CompareBtf(DecodeAll(**encoded), btf)->rel_error, 0.03);
}

TEST_P(EveryCodec, RefusesWhatCannotBeEncoded) {
  EXPECT_EQ(encoder().Encode(btf::SampledBtf(Header()), {}).status().code(),
            absl::StatusCode::kInvalidArgument);
  btf::SampledBtf nan = SyntheticBtf(Header());
  nan.MutableImage(1, 1)[2] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(encoder().Encode(nan, {}).status().code(), absl::StatusCode::kInvalidArgument);
  EncodeOptions options;
  options.terms = 100000;
  EXPECT_EQ(encoder().Encode(SyntheticBtf(Header()), options).status().code(),
            absl::StatusCode::kInvalidArgument);
}

// A file whose planes do not fit its header, or whose bytes are wrong, ends with a Status.
TEST_P(EveryCodec, SurvivesDamagedFiles) {
  TemporaryFolder folder;
  const btf::BtfHeader header =
      btf::SmallHeader(4, 3, RingDirections(1, 3, 40), RingDirections(1, 3, 40));
  const auto encoded = encoder().Encode(SyntheticBtf(header), {});
  ASSERT_TRUE(encoded.ok());
  ASSERT_TRUE(WriteEncodedBtf(**encoded, folder / "c").ok());
  const std::string valid = *ReadFile(folder / "c");
  std::mt19937 random(6);
  for (int i = 0; i < 1500; ++i) {
    std::string bytes = valid;
    for (size_t k = 1 + random() % 3; k > 0; --k) {
      bytes[random() % std::min<size_t>(bytes.size(), 3500)] = static_cast<char>(random());
    }
    if (i % 5 == 0) bytes.resize(random() % bytes.size());
    std::ofstream(folder / "bad", std::ios::binary | std::ios::trunc)
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    const auto read = ReadEncodedBtf(folder / "bad");
    if (read.ok()) (void)DecodeAll(**read);
  }
}

TEST_P(EveryCodec, RefusesPlanesOfAnotherHeader) {
  const auto encoded = encoder().Encode(SyntheticBtf(Header()), {});
  ASSERT_TRUE(encoded.ok());
  const auto decoder = FindDecoder(encoder().name());
  const auto decodes = [&](const auto& change) {
    btf::CodedBtf coded;
    coded.info = (*encoded)->info();
    for (const btf::Plane& plane : (*encoded)->Planes()) coded.planes.emplace(plane.name, plane);
    change(coded);
    return (*decoder)->Decode(std::move(coded)).ok();
  };
  EXPECT_TRUE(decodes([](btf::CodedBtf&) {}));
  EXPECT_FALSE(decodes([](btf::CodedBtf& coded) { coded.planes.clear(); }));
  EXPECT_FALSE(decodes([](btf::CodedBtf& coded) { coded.planes.erase(coded.planes.begin()); }));
  EXPECT_FALSE(decodes([](btf::CodedBtf& coded) {
    coded.info.header.width = 8;
    coded.info.header.mask.assign(coded.info.header.texel_count(), 1);
  }));
  EXPECT_FALSE(
      decodes([](btf::CodedBtf& coded) { coded.planes.begin()->second.channels[0] = "x"; }));
}

INSTANTIATE_TEST_SUITE_P(Registry, EveryCodec, ::testing::ValuesIn(AllEncoders()),
                         CodecOfTest);

}  // namespace
}  // namespace mesorig::codecs
