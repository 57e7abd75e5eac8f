// fmf, pvmf, pcmf and tucker: what they owe beyond the contract of every codec.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>

#include "processing/btf/errors.h"
#include "processing/codecs/algebra/local_pca.h"
#include "processing/codecs/algebra/matrix.h"
#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/linear_btf.h"
#include "processing/codecs/linear/linear_mips.h"
#include "processing/codecs/linear/sample_weights.h"
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

StatusOr<std::unique_ptr<EncodedBtf>> Encode(std::string_view codec, const btf::SampledBtf& btf,
                                             const EncodeOptions& options) {
  return (*FindEncoder(codec))->Encode(btf, options);
}

double Error(std::string_view codec, const btf::SampledBtf& btf, const EncodeOptions& options) {
  const auto encoded = Encode(codec, btf, options);
  EXPECT_TRUE(encoded.ok()) << encoded.status();
  return encoded.ok() ? MeasureDecoded(**encoded, btf).rel_error : 1e9;
}

// A row a texel, a column a channel of a pair of view `view`, or of all.
std::vector<double> SingularValues(const btf::SampledBtf& btf, int view = -1) {
  const btf::BtfHeader& h = btf.header();
  const auto texels = static_cast<int64_t>(h.texel_count());
  const int first = view < 0 ? 0 : view, last = view < 0 ? h.view_count() : view + 1;
  algebra::MatrixD m(texels, int64_t{3} * (last - first) * h.light_count());
  int64_t column = 0;
  for (int v = first; v < last; ++v) {
    for (int l = 0; l < h.light_count(); ++l) {
      for (int64_t c = 0; c < 3; ++c, ++column) {
        for (int64_t i = 0; i < texels; ++i) {
          m(i, column) = btf.Image(v, l)[static_cast<size_t>(3 * i + c)];
        }
      }
    }
  }
  return algebra::ThinSvd(std::move(m))->sigma;
}

double Tail(const std::vector<double>& sigma, int from) {
  double square = 0;
  for (size_t k = static_cast<size_t>(from); k < sigma.size(); ++k) square += sigma[k] * sigma[k];
  return square;
}

// Müller et al. 2004, Eq. 11; Eckart and Young.
TEST(LinearBases, FmfIsOptimalAtEveryRank) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  const std::vector<double> sigma = SingularValues(btf);
  for (int terms = 1; terms <= 12; ++terms) {
    const double best = std::sqrt(Tail(sigma, terms) / Tail(sigma, 0));
    EXPECT_NEAR(Error("fmf", btf, Terms(terms)), best, 0.01 * best + 1e-6) << terms;
  }
}

// Müller et al. 2004, Eq. 12.
TEST(LinearBases, PvmfIsOptimalOfEveryView) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  for (const int terms : {1, 2, 4}) {
    double rest = 0, all = 0;
    for (int v = 0; v < btf.header().view_count(); ++v) {
      const std::vector<double> sigma = SingularValues(btf, v);
      rest += Tail(sigma, terms), all += Tail(sigma, 0);
    }
    const double best = std::sqrt(rest / all);
    EXPECT_NEAR(Error("pvmf", btf, Terms(terms)), best, 0.01 * best + 1e-6) << terms;
  }
}

// Two materials side by side, each of rank 1 around its mean: two clusters of one term hold them.
btf::SampledBtf TwoMaterials() {
  btf::SampledBtf btf(btf::SmallHeader(12, 8, RingDirections(1, 6, 50), RingDirections(1, 6, 50)));
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      btf.SetPresent(v, l, true);
      auto image = btf.MutableImage(v, l);
      for (size_t i = 0; i < image.size(); ++i) {
        const size_t texel = i / 3;
        const double s = std::sin(1.7 * static_cast<double>(texel));
        image[i] = static_cast<float>(texel % 12 < 6 ? 0.3 + 0.05 * s * std::cos(v + l)
                                                     : 0.1 + 0.02 * l + 0.04 * s * std::sin(v * l));
      }
    }
  }
  return btf;
}

// Müller et al. 2004, Eq. 13.
TEST(LinearBases, PcmfFindsMaterialsThatAreLinearEach) {
  const btf::SampledBtf btf = TwoMaterials();
  EncodeOptions options = Terms(1);
  options.clusters = 2;
  EXPECT_LT(Error("pcmf", btf, options), 1e-5);
  EXPECT_GT(Error("fmf", btf, Terms(1)), 0.02);
  EXPECT_LT(Error("pcmf", btf, options), Error("fmf", btf, Terms(2)));
}

TEST(LinearBases, PcmfDropsClustersThatNothingNeeds) {
  const btf::SampledBtf btf = TwoMaterials();
  EncodeOptions options = Terms(2);
  options.clusters = 20;
  const auto encoded = Encode("pcmf", btf, options);
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  const auto& factors = static_cast<const LinearBtf&>(**encoded).factors();
  std::vector<int> sizes(static_cast<size_t>(factors.shape.clusters), 0);
  for (const uint16_t k : factors.cluster) ++sizes[k];
  EXPECT_THAT(sizes, ::testing::Each(::testing::Gt(0)));
  EXPECT_LT(MeasureDecoded(**encoded, btf).rel_error, 1e-5);
}

TEST(LocalPca, ErrorsFallAndDeadClustersStartAgain) {
  algebra::MatrixF points(300, 5);
  std::mt19937 random(3);
  std::normal_distribution<float> normal;
  for (int64_t i = 0; i < 300; ++i) {  // three lines in five dimensions
    const float t = normal(random);
    for (int64_t j = 0; j < 5; ++j) {
      points(i, j) = (j == i % 3 ? t : 0.0f) + (j == 4 ? static_cast<float>(i % 3) : 0.0f) +
                     0.001f * normal(random);
    }
  }
  algebra::LocalPcaOptions options;
  options.clusters = 3;
  options.terms = 1;
  const std::vector<float> weights(300, 1.0f);
  const auto result = algebra::ClusterByLocalPca(points, weights, options);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->clusters, 3);
  for (int64_t i = 3; i < 300; ++i) {
    EXPECT_EQ(result->cluster[static_cast<size_t>(i)], result->cluster[static_cast<size_t>(i % 3)]);
  }
  for (size_t k = 1; k < result->errors.size(); ++k) {
    EXPECT_LE(result->errors[k], result->errors[k - 1] * (1 + 1e-9));
  }
  const algebra::MatrixF same(50, 4);  // duplicates: one cluster is all that can be
  const auto one = algebra::ClusterByLocalPca(same, std::vector<float>(50, 1.0f), options);
  ASSERT_TRUE(one.ok());
  EXPECT_EQ(one->clusters, 1);
  EXPECT_FALSE(algebra::ClusterByLocalPca(points, {}, options).ok());
}

// The coarsest level of a material decodes to the mean of all its texels, as far as the bases reach.
TEST(LinearMips, CoarsestLevelIsTheMean) {
  const btf::SampledBtf btf = SyntheticBtf(
      btf::SmallHeader(8, 8, RingDirections(1, 4, 50), RingDirections(1, 4, 50)), 0.1);
  for (const char* codec : {"fmf", "pcmf"}) {
    for (const Weighting weighting : {Weighting::kLinear, Weighting::kLog}) {
      EncodeOptions options = Terms(6);
      options.weighting = weighting;
      const auto encoded = Encode(codec, btf, options);
      ASSERT_TRUE(encoded.ok()) << encoded.status();
      const LinearFactors& f = static_cast<const LinearBtf&>(**encoded).factors();
      const MipFactors mips = FitMips((*encoded)->info(), f, 0);
      const auto stride = static_cast<size_t>(f.shape.stride());
      ASSERT_EQ(mips.g.size(), (16u + 4 + 1) * stride);
      const float* const g = mips.g.data() + 20 * stride;
      std::vector<float> image(btf.image_size());
      double error = 0, norm = 0;
      for (int v = 0; v < btf.header().view_count(); ++v) {
        for (int l = 0; l < btf.header().light_count(); ++l) {
          if (!btf.Present(v, l)) continue;
          (*encoded)->DecodeImage(v, l, image);
          const size_t row = (static_cast<size_t>(mips.cluster[20]) * f.shape.pairs(btf.header()) +
                              btf.PairIndex(v, l)) * 3;
          for (size_t c = 0; c < 3; ++c) {
            double mean = 0, sum = 0;
            for (size_t i = c; i < image.size(); i += 3) mean += image[i] / 64;
            for (size_t k = 0; k < stride; ++k) sum += g[k] * f.h[(row + c) * stride + k];
            if (f.log_floor > 0) sum = std::exp(sum) - f.log_floor;
            error += std::pow(sum - mean, 2), norm += mean * mean;
          }
        }
      }
      EXPECT_LT(std::sqrt(error / norm), 0.03) << codec;
    }
  }
}

class LinearCodec : public ::testing::TestWithParam<const char*> {};

TEST_P(LinearCodec, AllTermsReproduceTheInput) {
  const btf::SampledBtf btf = SyntheticBtf(
      btf::SmallHeader(4, 3, RingDirections(1, 4, 50), RingDirections(1, 4, 50)), 0.2);
  EncodeOptions options;
  options.terms = kAllTerms;
  EXPECT_LT(Error(GetParam(), btf, options), 1e-5);
}

TEST_P(LinearCodec, LogWeightingServesTheDark) {
  btf::SampledBtf btf = SyntheticBtf(Header());
  for (int l = 0; l < btf.header().light_count(); ++l) {
    for (float& x : btf.MutableImage(2, l)) x *= 1e-3f;
  }
  const auto of_dark = [&](Weighting weighting) {
    EncodeOptions options = Terms(3);
    options.weighting = weighting;
    options.floor = 1e-5;
    const auto encoded = Encode(GetParam(), btf, options);
    EXPECT_TRUE(encoded.ok()) << encoded.status();
    const btf::SampledBtf decoded = DecodeAll(**encoded);
    double worst = 0, norm = 0;
    for (size_t i = 0; i < btf.image_size(); ++i) {
      worst += std::abs(decoded.Image(2, 3)[i] - btf.Image(2, 3)[i]);
      norm += std::abs(btf.Image(2, 3)[i]);
    }
    return worst / norm;
  };
  EXPECT_LT(of_dark(Weighting::kLog), 0.15);
  EXPECT_LT(of_dark(Weighting::kRelative), 0.2);
}

TEST_P(LinearCodec, TargetsAreMetWithTheFewestOrTheMostTerms) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  const Encoder& encoder = **FindEncoder(GetParam());
  const auto terms_of = [](const EncodedBtf& encoded) {
    return nlohmann::json::parse(encoded.info().codec_options_json)["terms"].get<int>();
  };
  const auto precise = EncodeToTarget(encoder, btf, {}, {.error = 0.05});
  ASSERT_TRUE(precise.ok()) << precise.status();
  EXPECT_LE(MeasureDecoded(**precise, btf).rel_error, 0.05);
  const int terms = terms_of(**precise);
  if (terms > 1) {
    EncodeOptions fewer;
    fewer.terms = terms - 1;
    EXPECT_GT(Error(GetParam(), btf, fewer), 0.05);
  }
  const uint64_t budget = *FileBytes(**precise) + 1000;
  const auto small = EncodeToTarget(encoder, btf, {}, {.bytes = budget});
  ASSERT_TRUE(small.ok()) << small.status();
  EXPECT_LE(*FileBytes(**small), budget);
  EXPECT_GE(terms_of(**small), terms);
  EXPECT_FALSE(EncodeToTarget(encoder, btf, {}, {.error = 1e-9}).ok());
  EXPECT_FALSE(EncodeToTarget(encoder, btf, {}, {.bytes = 10}).ok());
  EXPECT_FALSE(EncodeToTarget(encoder, btf, {}, {}).ok());
}

INSTANTIATE_TEST_SUITE_P(LinearBases, LinearCodec, ::testing::Values("fmf", "pvmf", "pcmf", "tucker"),
                         [](const auto& parameter) { return std::string(parameter.param); });

TEST(SampleWeights, APoleThatIsSeenTwelveTimesCountsOnce) {
  std::vector<Vec3> directions = RingDirections(4, 12, 70);
  const double alone = SolidAngleWeights(directions)[0] / SolidAngleWeights(directions)[1];
  for (int i = 1; i < 12; ++i) {
    directions.push_back(DirectionFromAngles(1e-5, 2 * kPi * i / 12));
  }
  const std::vector<double> weights = SolidAngleWeights(directions);
  double pole = weights[0];
  for (size_t i = directions.size() - 11; i < directions.size(); ++i) pole += weights[i];
  EXPECT_NEAR(pole / weights[1], alone, 0.6 * alone + 12 * 0.02);
  EXPECT_EQ(SolidAngleWeights({{0, 0, 1}})[0], 1);
}

TEST(SampleWeights, SolidAngleMovesTheErrorFromCrowdedDirections) {
  std::vector<Vec3> views = RingDirections(2, 6, 60);
  for (int i = 1; i < 10; ++i) views.push_back(DirectionFromAngles(0.002 * i, 0.7 * i));
  const btf::SampledBtf btf = SyntheticBtf(
      btf::SmallHeader(8, 6, views, RingDirections(2, 6, 60)));
  const auto far_error = [&](bool solid_angle) {
    EncodeOptions options = Terms(3);
    options.solid_angle = solid_angle;
    const btf::SampledBtf decoded = DecodeAll(**Encode("fmf", btf, options));
    double error = 0;
    for (int v = 7; v < 13; ++v) {
      for (int l = 0; l < btf.header().light_count(); ++l) {
        for (size_t i = 0; i < btf.image_size(); ++i) {
          error += std::pow(decoded.Image(v, l)[i] - btf.Image(v, l)[i], 2);
        }
      }
    }
    return error;
  };
  EXPECT_LT(far_error(true), far_error(false));
}

TEST(EncodeOptions, WhatACodecDoesNotHaveIsRefused) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  EncodeOptions clusters, log, bytes;
  clusters.clusters = 4;
  log.weighting = Weighting::kLog;
  bytes.quantisation = Quantisation::kByte;
  EXPECT_FALSE(Encode("fmf", btf, clusters).ok());
  EXPECT_FALSE(Encode("mean", btf, log).ok());
  EXPECT_FALSE(Encode("rf-ptm", btf, bytes).ok());
  btf::SampledBtf bad = btf;
  bad.MutableImage(3, 5)[3 * (2 * 8 + 6) + 1] = std::numeric_limits<float>::infinity();
  EXPECT_THAT(std::string(Message(Encode("fmf", bad, {}).status())),
              ::testing::HasSubstr("view 3, light 5, texel (6, 2), channel G"));
}

}  // namespace
}  // namespace mesorig::codecs
