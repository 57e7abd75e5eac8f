#include "processing/codecs/view_svd/view_svd.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <limits>

#include "processing/btf/errors.h"
#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/sample_weights.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::codecs::view_svd {
namespace {

using btf::RingDirections;
using btf::SyntheticBtf;

btf::BtfHeader Header() {
  return btf::SmallHeader(8, 6, RingDirections(2, 6, 60), RingDirections(2, 8, 60));
}

std::unique_ptr<EncodedBtf> Encoded(const btf::SampledBtf& btf, int terms) {
  EncodeOptions options;
  options.terms = terms;
  auto encoded = (*FindEncoder(kName))->Encode(btf, options);
  EXPECT_TRUE(encoded.ok()) << encoded.status();
  return *std::move(encoded);
}

double RelError(const btf::SampledBtf& btf, int terms) {
  return btf::CompareBtf(DecodeAll(*Encoded(btf, terms)), btf)->rel_error;
}

// A BTF of rank `rank` over the views: sum of products of functions of the view and of the rest.
btf::SampledBtf OfRank(int rank, double absent) {
  btf::SampledBtf btf = SyntheticBtf(Header(), absent);
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      auto image = btf.MutableImage(v, l);
      for (size_t i = 0; i < image.size(); ++i) {
        double sum = 0;
        for (int k = 0; k < rank; ++k) {
          sum += std::cos(1.3 * (k + 1) * v + k) *
                 std::sin(0.37 * (k + 2) * static_cast<double>(i) + 0.9 * l * (k + 1));
        }
        image[i] = static_cast<float>(sum);
      }
    }
  }
  return btf;
}

// Wang et al. 2005, Sec. 5, with nothing left out.
TEST(ViewSvd, AllTermsReproduceTheInput) {
  EXPECT_LT(RelError(SyntheticBtf(Header()), kAllTerms), 1e-6);
  EXPECT_LT(RelError(SyntheticBtf(Header(), 0.1), kAllTerms), 1e-6);
}

TEST(ViewSvd, AllTermsReproduceAlsoWhatIsTenThousandTimesWeaker) {
  btf::SampledBtf btf = SyntheticBtf(Header());
  for (int l = 0; l < btf.header().light_count(); ++l) {
    for (float& x : btf.MutableImage(5, l)) x *= 1e-4f;
  }
  const btf::SampledBtf decoded = DecodeAll(*Encoded(btf, kAllTerms));
  for (size_t i = 0; i < btf.image_size(); ++i) {
    EXPECT_NEAR(decoded.Image(5, 3)[i], btf.Image(5, 3)[i], 2e-7);
  }
}

// Eckart-Young: no matrix of that rank comes closer than the sum of the singular values left out.
TEST(ViewSvd, ErrorIsThatOfTheBestMatrixOfItsRank) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  const int views = btf.header().view_count(), lights = btf.header().light_count();
  const auto size = static_cast<Eigen::Index>(btf.image_size());
  Eigen::MatrixXd m(lights * size, views);
  for (int v = 0; v < views; ++v) {
    for (int l = 0; l < lights; ++l) {
      const Eigen::Map<const Eigen::VectorXf> image(btf.Image(v, l).data(), size);
      m.block(l * size, v, size, 1) = image.cast<double>();
    }
  }
  // By way of the Gram matrix: an SVD template takes a minute to compile under the sanitizers.
  const Eigen::MatrixXd gram = m.transpose() * m;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(gram, Eigen::EigenvaluesOnly);
  const Eigen::VectorXd sigma = solver.eigenvalues().reverse().cwiseMax(0).cwiseSqrt();
  double before = 1;
  for (int terms = 1; terms <= 8; ++terms) {
    const double best = sigma.tail(views - terms).norm() / sigma.norm();
    const double now = RelError(btf, terms);
    EXPECT_NEAR(now, best, 1e-4 + 0.01 * best) << terms;  // half's rounding
    EXPECT_LT(now, before);
    before = now;
  }
}

TEST(ViewSvd, LowRankIsFoundExactly) { EXPECT_LT(RelError(OfRank(3, 0), 3), 2e-3); }

// Absent pairs have weight zero: the present ones come back as well as if nothing lacked.
TEST(ViewSvd, TenthAbsentThePresentOnesComeBack) {
  EXPECT_LT(RelError(OfRank(3, 0.1), 3), 2e-3);
  const btf::SampledBtf full = SyntheticBtf(Header()), holes = SyntheticBtf(Header(), 0.1);
  EXPECT_LT(RelError(holes, 4), 1.1 * RelError(full, 4) + 1e-3);
}

TEST(ViewSvd, WhatStandsInAbsentPairsDoesNotMatter) {
  const btf::SampledBtf a = SyntheticBtf(Header(), 0.2);
  btf::SampledBtf b = a;
  for (int v = 0; v < a.header().view_count(); ++v) {
    for (int l = 0; l < a.header().light_count(); ++l) {
      if (a.Present(v, l)) continue;
      for (float& x : b.MutableImage(v, l)) x = std::numeric_limits<float>::quiet_NaN();
    }
  }
  EXPECT_EQ(btf::CompareBtf(DecodeAll(*Encoded(b, 4)), DecodeAll(*Encoded(a, 4)))->max_abs, 0);
}

TEST(ViewSvd, AbsentPairsAreFilledByTheFactors) {
  const btf::SampledBtf holes = OfRank(2, 0.2), full = OfRank(2, 0);
  const auto encoded = Encoded(holes, 2);
  std::vector<float> image(full.image_size());
  double error = 0, norm = 0;
  for (int v = 0; v < full.header().view_count(); ++v) {
    for (int l = 0; l < full.header().light_count(); ++l) {
      encoded->DecodeImage(v, l, image);
      for (size_t i = 0; i < image.size(); ++i) {
        error += std::pow(image[i] - full.Image(v, l)[i], 2);
        norm += std::pow(full.Image(v, l)[i], 2);
      }
    }
  }
  EXPECT_LT(std::sqrt(error / norm), 5e-3);
}

TEST(ViewSvd, OneViewIsItself) {
  const btf::SampledBtf btf =
      SyntheticBtf(btf::SmallHeader(8, 6, {{0, 0, 1}}, RingDirections(1, 5, 40)));
  EXPECT_LT(RelError(btf, 0), 1e-3);
}

TEST(ViewSvd, BytesCostLittle) {
  btf::TemporaryFolder folder;
  const btf::SampledBtf btf = SyntheticBtf(Header());
  EncodeOptions options;
  options.quantisation = Quantisation::kByte;
  const auto encoded = (*FindEncoder(kName))->Encode(btf, options);
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  EXPECT_LT(btf::CompareBtf(DecodeAll(**encoded), btf)->rel_error, RelError(btf, 0) + 0.01);
  ASSERT_TRUE(WriteEncodedBtf(**encoded, folder / "c").ok());
  const auto read = ReadEncodedBtf(folder / "c");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ((*read)->info().codec_version, 2);
  EXPECT_EQ(btf::CompareBtf(DecodeAll(**read), DecodeAll(**encoded))->max_abs, 0);
}

// With all terms any weighting reproduces the input. With few, the error that it asks for is smaller, or,
// for relative weights, whose nearest product of a view and a light is taken, hardly larger.
TEST(ViewSvd, WeightsMoveTheErrorAndLoseNothing) {
  btf::BtfHeader header = Header();
  for (int i = 1; i < 10; ++i) header.views.push_back(DirectionFromAngles(0.004 * i, 0.7 * i));
  btf::SampledBtf btf = SyntheticBtf(header);
  for (int l = 0; l < btf.header().light_count(); ++l) {
    for (float& x : btf.MutableImage(5, l)) x *= 1e-3f;
  }
  EncodeOptions solid_angle, relative;
  solid_angle.solid_angle = true;
  relative.weighting = Weighting::kRelative;
  relative.floor = 1e-4;
  const auto weighted_error = [&](const SampleWeights& weights, EncodeOptions options, int terms) {
    options.terms = terms;
    options.quantisation = Quantisation::kFloat;
    const auto encoded = (*FindEncoder(kName))->Encode(btf, options);
    EXPECT_TRUE(encoded.ok()) << encoded.status();
    const btf::SampledBtf decoded = DecodeAll(**encoded);
    double error = 0, norm = 0;
    for (int v = 0; v < btf.header().view_count(); ++v) {
      for (int l = 0; l < btf.header().light_count(); ++l) {
        for (size_t i = 0; i < btf.image_size(); ++i) {
          const double w = weights.texel[i / 3] * weights.sample[3 * btf.PairIndex(v, l) + i % 3];
          error += std::pow(w * (decoded.Image(v, l)[i] - btf.Image(v, l)[i]), 2);
          norm += std::pow(w * btf.Image(v, l)[i], 2);
        }
      }
    }
    return std::sqrt(error / norm);
  };
  for (const auto& [options, at_most] : {std::pair{solid_angle, 1.0}, {relative, 1.03}}) {
    const SampleWeights weights = *WeightsFor(MemorySource(btf), options);
    for (const int terms : {1, 2, 3, 4}) {
      EXPECT_LT(weighted_error(weights, options, terms),
                at_most * weighted_error(weights, {}, terms)) << terms;
    }
    EXPECT_LT(weighted_error(weights, options, kAllTerms), 1e-4);
  }
}

// What a shader gets gives what DecodeImage gives.
TEST(ViewSvd, ShaderForm) {
  const btf::SampledBtf btf = SyntheticBtf(Header(), 0.1);
  const auto encoded = Encoded(btf, 4);
  const auto form = encoded->ToShader();
  ASSERT_TRUE(form.has_value());
  EXPECT_EQ(form->columns, 4);
  EXPECT_EQ(form->layers, 4 * 17);
  EXPECT_EQ(form->table.size(), 13u * 4) << "absent pairs are the renderer's, not the decoder's";
  EXPECT_NE(form->glsl.find("vec3 DecodeBtf("), std::string::npos);
  std::vector<float> image(btf.image_size());
  encoded->DecodeImage(7, 11, image);
  for (size_t i = 0; i < image.size(); ++i) {
    float sum = 0;
    for (size_t k = 0; k < 4; ++k) {
      sum += form->table[7 * 4 + k] * form->rgb[(11 * 4 + k) * image.size() + i];
    }
    EXPECT_NEAR(sum, image[i], 1e-6);
  }
}

}  // namespace
}  // namespace mesorig::codecs::view_svd
