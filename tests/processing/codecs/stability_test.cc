// What every codec with factors owes numerically, whatever its model: degenerate inputs, scales, holes,
// threads, blocks, quantised and damaged files. A new codec that can choose its quantisation is tested
// without a line here.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <random>

#include "processing/btf/errors.h"
#include "processing/codecs/algebra/matrix.h"
#include "processing/codecs/encoder.h"
#include "processing/codecs/target.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"
#include "tests/processing/codecs/encoding.h"

namespace mesorig::codecs {
namespace {

using btf::RingDirections;
using btf::SyntheticBtf;

btf::BtfHeader Header() {
  return btf::SmallHeader(8, 6, RingDirections(2, 6, 60), RingDirections(2, 8, 60));
}

std::vector<const Encoder*> WithFactors() {
  std::vector<const Encoder*> encoders;
  for (const Encoder* encoder : AllEncoders()) {
    if ((encoder->options() & kQuantisation) != 0) encoders.push_back(encoder);
  }
  return encoders;
}

class StableCodec : public ::testing::TestWithParam<const Encoder*> {
 protected:
  bool Takes(OptionSet option) const { return (GetParam()->options() & option) != 0; }
  // Without what the codec does not take; fewer terms where there are not as many.
  StatusOr<std::unique_ptr<EncodedBtf>> Encode(const btf::SampledBtf& btf,
                                               EncodeOptions options) const {
    if (!Takes(kLogWeighting) && options.weighting == Weighting::kLog) {
      options.weighting = Weighting::kLinear;
    }
    if (!Takes(kWeighting)) {
      options.solid_angle = false;
      if (options.weighting == Weighting::kRelative) options.weighting = Weighting::kLinear;
    }
    if (!Takes(kClusters)) options.clusters = 0;
    if (options.terms > 0) options.terms = std::min(options.terms, GetParam()->max_terms(btf));
    return GetParam()->Encode(btf, options);
  }
  double Error(const btf::SampledBtf& btf, const EncodeOptions& options) const {
    const auto encoded = Encode(btf, options);
    EXPECT_TRUE(encoded.ok()) << encoded.status();
    return encoded.ok() ? MeasureDecoded(**encoded, btf).rel_error : 1e9;
  }
};

TEST_P(StableCodec, DegenerateInputs) {
  const std::pair<btf::BtfHeader, const char*> sizes[] = {
                      {Header(), "constant"},
                      {btf::SmallHeader(1, 1, RingDirections(1, 4, 50), RingDirections(1, 4, 50)),
                       "one texel"},
                      {btf::SmallHeader(5, 4, {{0, 0, 1}}, RingDirections(1, 4, 50)), "one view"},
                      {btf::SmallHeader(5, 4, RingDirections(1, 4, 50), {{0, 0, 1}}), "one light"},
                      {btf::SmallHeader(1, 1, {{0, 0, 1}}, {{0, 0, 1}}), "one value"}};
  for (const auto& [header, what] : sizes) {
    for (const float value : {0.0f, 0.25f}) {
      btf::SampledBtf btf(header);
      for (int v = 0; v < header.view_count(); ++v) {
        for (int l = 0; l < header.light_count(); ++l) {
          btf.SetPresent(v, l, true);
          for (float& x : btf.MutableImage(v, l)) x = value;
        }
      }
      for (const Weighting weighting : {Weighting::kLinear, Weighting::kRelative, Weighting::kLog}) {
        EncodeOptions options;
        options.weighting = weighting;
        options.solid_angle = true;
        const auto encoded = Encode(btf, options);
        ASSERT_TRUE(encoded.ok()) << what << ": " << encoded.status();
        EXPECT_LT(MeasureDecoded(**encoded, btf).max_abs, 1e-3) << what;
      }
    }
  }
}

TEST_P(StableCodec, QuantisationCostsLittleAndIsKept) {
  btf::TemporaryFolder folder;
  const btf::SampledBtf btf = SyntheticBtf(Header(), 0.1);
  EncodeOptions options = Terms(4);
  const double exact = Error(btf, options);
  constexpr std::pair<Quantisation, double> kSlack[] = {{Quantisation::kHalf, 1e-3},
                                                        {Quantisation::kByte, 2e-2}};
  for (const auto& [quantisation, slack] : kSlack) {
    options.quantisation = quantisation;
    const auto encoded = Encode(btf, options);
    ASSERT_TRUE(encoded.ok());
    EXPECT_LT(MeasureDecoded(**encoded, btf).rel_error, exact + slack);
    ASSERT_TRUE(WriteEncodedBtf(**encoded, folder / "c").ok());
    const auto read = ReadEncodedBtf(folder / "c");
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_LT(btf::CompareBtf(DecodeAll(**read), DecodeAll(**encoded))->max_abs, 1e-6);
    ASSERT_TRUE(WriteEncodedBtf(**read, folder / "d").ok());
    EXPECT_EQ(*FileBytes(**read), std::filesystem::file_size(folder / "c"));
  }
}

// Files of bytes, under a logarithm, with bytes changed at random: an error or a BTF, no crash.
TEST_P(StableCodec, SurvivesDamagedFilesOfBytes) {
  btf::TemporaryFolder folder;
  EncodeOptions options = Terms(2);
  options.quantisation = Quantisation::kByte;
  options.weighting = Weighting::kLog;
  const auto encoded = Encode(
      SyntheticBtf(btf::SmallHeader(5, 3, RingDirections(1, 3, 40), RingDirections(1, 3, 40))),
      options);
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  ASSERT_TRUE(WriteEncodedBtf(**encoded, folder / "c").ok());
  const std::string valid = *ReadFile(folder / "c");
  std::mt19937 random(6);
  for (int i = 0; i < 400; ++i) {
    std::string bytes = valid;
    for (size_t k = 1 + random() % 3; k > 0; --k) {
      bytes[random() % bytes.size()] = static_cast<char>(random());
    }
    if (i % 5 == 0) bytes.resize(random() % bytes.size());
    std::ofstream(folder / "bad", std::ios::binary | std::ios::trunc)
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    const auto read = ReadEncodedBtf(folder / "bad");
    if (!read.ok()) continue;
    const btf::SampledBtf decoded = DecodeAll(**read);
    EXPECT_TRUE(std::isfinite(decoded.Image(0, 0)[0]));
    (void)(*read)->ToShader();
  }
}

// Values far beyond half's range, and one mirror texel a million times brighter than the rest.
TEST_P(StableCodec, HugeScaleAndDynamicRange) {
  btf::SampledBtf huge = SyntheticBtf(Header());
  for (int v = 0; v < huge.header().view_count(); ++v) {
    for (int l = 0; l < huge.header().light_count(); ++l) {
      for (float& x : huge.MutableImage(v, l)) x *= 1e9f;
    }
  }
  EncodeOptions options = Terms(6);
  const double expected = Error(SyntheticBtf(Header()), options);
  for (const Quantisation q : {Quantisation::kHalf, Quantisation::kFloat}) {
    options.quantisation = q;
    EXPECT_NEAR(Error(huge, options), expected, 1e-3);
  }
  btf::SampledBtf mirror = SyntheticBtf(Header());
  for (float& x : mirror.MutableImage(4, 3).subspan(30, 3)) x = 1e6f;
  btf::SampledBtf matte = mirror;  // the same without its mirror, to compare with
  const auto of_matte = [&](Weighting weighting) {
    EncodeOptions o = Terms(4);
    o.weighting = weighting;
    if (Takes(kLogWeighting)) o.clusters = 1;  // else the mirror would be a part of every texel
    o.floor = 0.01;
    const auto encoded = Encode(mirror, o);
    EXPECT_TRUE(encoded.ok()) << encoded.status();
    const btf::SampledBtf decoded = DecodeAll(**encoded);
    double error = 0, norm = 0;
    for (int v = 0; v < 4; ++v) {  // views that the mirror is not in
      for (int l = 0; l < 3; ++l) {
        for (size_t i = 0; i < matte.image_size(); ++i) {
          if (i / 3 == 10) continue;
          error += std::pow(decoded.Image(v, l)[i] - matte.Image(v, l)[i], 2);
          norm += std::pow(matte.Image(v, l)[i], 2);
        }
      }
    }
    return std::sqrt(error / norm);
  };
  EXPECT_LT(of_matte(Weighting::kRelative), 0.2);
  EXPECT_LT(of_matte(Weighting::kLog), 0.3);
}

// A product of a texel's, a view's and a light's number, of rank one, with more terms than it has.
TEST_P(StableCodec, MoreTermsThanTheRankLoseNothing) {
  btf::SampledBtf btf(Header());
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      btf.SetPresent(v, l, true);
      for (size_t i = 0; i < btf.image_size(); ++i) {
        btf.MutableImage(v, l)[i] = (0.3f + 0.02f * static_cast<float>(i / 3)) *
                                    (0.5f + 0.1f * static_cast<float>(v % 5)) *
                                    (0.4f + 0.07f * static_cast<float>(l % 7));
      }
    }
  }
  for (const double absent : {0.0, 0.2}) {
    for (int pair = 0; absent > 0 && pair < 40; ++pair) {
      btf.SetPresent(pair % btf.header().view_count(), (5 * pair) % btf.header().light_count(), false);
    }
    for (const int terms : {1, 6}) {
      // Linear bases meet it; hf adds a floor before its product, dfmf's luma is a logarithm, and cmf's
      // few sweeps begin with holes filled in (measured 0.009).
      const auto name = GetParam()->name();
      const double bound = name == "hf"     ? 0.1
                           : name == "dfmf" ? (terms == 1 ? 0.2 : 0.01)
                           : name == "cmf"  ? 0.02
                                            : 1e-4;
      EXPECT_LT(Error(btf, Terms(terms)), bound) << terms << " terms, absent " << absent;
    }
  }
}

// One mirror texel, a million times brighter than the rest: unweighted it is what counts, and is met.
TEST_P(StableCodec, AMirrorAmongMatteTexelsIsMetUnweighted) {
  btf::SampledBtf btf = SyntheticBtf(Header());
  for (float& x : btf.MutableImage(4, 3).subspan(30, 3)) x = 1e6f;
  const auto encoded = Encode(btf, Terms(4));
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  const DecodedErrors errors = MeasureDecoded(**encoded, btf);
  EXPECT_TRUE(std::isfinite(errors.rel_error) && std::isfinite(errors.max_abs));
  // (hf is one smooth product: measured 0.996, it has no room for a single sample.)
  EXPECT_LT(errors.rel_error, GetParam()->name() == "hf" ? 1.0 : 0.5);
}

TEST_P(StableCodec, WhatIsNotFiniteIsRefusedWithItsPlace) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(),
                          std::numeric_limits<float>::infinity(),
                          -std::numeric_limits<float>::infinity()}) {
    btf::SampledBtf btf = SyntheticBtf(Header());
    btf.MutableImage(3, 5)[3 * (2 * 8 + 6) + 1] = bad;
    const Status refused = Encode(btf, Terms(2)).status();
    EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(Message(refused)),
                ::testing::HasSubstr("view 3, light 5, texel (6, 2), channel G"));
    // Absent, it is not looked at.
    btf.SetPresent(3, 5, false);
    EXPECT_LT(Error(btf, Terms(4)), 1.2 * Error(SyntheticBtf(Header()), Terms(4)) + 1e-3);
  }
}

TEST_P(StableCodec, FactorsOfHugeScaleAsBytes) {
  EncodeOptions options = Terms(5);
  options.quantisation = Quantisation::kByte;
  const double expected = Error(SyntheticBtf(Header()), options);
  for (const float scale : {1e-9f, 1e12f}) {
    btf::SampledBtf btf = SyntheticBtf(Header());
    for (int v = 0; v < btf.header().view_count(); ++v) {
      for (int l = 0; l < btf.header().light_count(); ++l) {
        for (float& x : btf.MutableImage(v, l)) x *= scale;
      }
    }
    EXPECT_NEAR(Error(btf, options), expected, 5e-3) << scale;
  }
}

// Weights and holes at once: what is present is no worse met for what is not there.
TEST_P(StableCodec, MissingPairsUnderWeights) {
  if (!Takes(kWeighting)) GTEST_SKIP() << "has no weights";
  EncodeOptions options = Terms(4);
  options.solid_angle = true;
  options.weighting = Weighting::kRelative;
  EXPECT_LT(Error(SyntheticBtf(Header(), 0.2), options),
            1.3 * Error(SyntheticBtf(Header()), options) + 1e-3);
}

TEST_P(StableCodec, OneThreadAndTwoAgree) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  const int before = algebra::Threads();
  algebra::SetThreads(1);
  const auto one = Encode(btf, Terms(5));
  algebra::SetThreads(2);
  const auto two = Encode(btf, Terms(5));
  algebra::SetThreads(before);
  ASSERT_TRUE(one.ok() && two.ok());
  EXPECT_LT(btf::CompareBtf(DecodeAll(**one), DecodeAll(**two))->max_abs, 1e-5);
}

TEST_P(StableCodec, MissingPairsDoNotSpoilThePresentOnes) {
  const double full = Error(SyntheticBtf(Header()), Terms(4));
  const double holes = Error(SyntheticBtf(Header(), 0.2), Terms(4));
  EXPECT_LT(holes, 1.2 * full + 1e-3);
}

TEST_P(StableCodec, BlocksDoNotMatter) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  EncodeOptions options = Terms(4);
  const double at_once = Error(btf, options);
  options.block_bytes = 4096;
  EXPECT_NEAR(Error(btf, options), at_once, 1e-4);
}

// Every level's weights decode to about the mean of the texels below: constant material stays itself.
TEST_P(StableCodec, ShaderFormsHoldTheirFactors) {
  const btf::SampledBtf btf = SyntheticBtf(Header(), 0.1);
  for (const Weighting weighting : {Weighting::kLinear, Weighting::kLog}) {
    EncodeOptions options = Terms(4);
    options.weighting = weighting;
    const auto encoded = Encode(btf, options);
    ASSERT_TRUE(encoded.ok());
    const auto form = (*encoded)->ToShader();
    ASSERT_TRUE(form.has_value());
    EXPECT_EQ(form->rgb.size(), static_cast<size_t>(form->layers) * btf.image_size());
    EXPECT_NE(form->glsl.find("vec3 DecodeBtf("), std::string::npos);
    for (const float x : form->rgb) EXPECT_TRUE(std::isfinite(x));
    for (const float x : form->table) EXPECT_TRUE(std::isfinite(x));
  }
}

INSTANTIATE_TEST_SUITE_P(Registry, StableCodec, ::testing::ValuesIn(WithFactors()),
                         CodecOfTest);

}  // namespace
}  // namespace mesorig::codecs
