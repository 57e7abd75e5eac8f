// svd2, hf and cmf: what they owe beside the contract and stability_test.cc.

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "processing/btf/errors.h"
#include "processing/codecs/algebra/matrix.h"
#include "processing/codecs/encoder.h"
#include "processing/codecs/per_texel/chain_btf.h"
#include "processing/codecs/per_texel/chain_fit.h"
#include "processing/codecs/target.h"
#include "tests/processing/btf/synthetic.h"
#include "tests/processing/codecs/encoding.h"

namespace mesorig::codecs::per_texel {
namespace {

using btf::RingDirections;
using btf::SyntheticBtf;

btf::BtfHeader Header() {
  return btf::SmallHeader(4, 3, RingDirections(2, 6, 60), RingDirections(2, 8, 60));
}

double Error(std::string_view codec, const btf::SampledBtf& btf, int terms) {
  return ErrorOf(**FindEncoder(codec), btf, Terms(terms));
}

TEST(Parameterisation, HalfAndDifference) {
  const Vec3 v = DirectionFromAngles(0.5, 1), l = DirectionFromAngles(1.1, 4);
  const Vec3 h = HalfVector(v, l);
  EXPECT_NEAR(Dot(h, v), Dot(h, l), 1e-12);
  // Turned so that h is +z: angles to h are angles to +z, and v lies opposite to l.
  const Vec3 d = Difference(v, l), e = Difference(l, v);
  EXPECT_NEAR(d.z, Dot(h, l), 1e-12);
  EXPECT_NEAR(d.x + e.x, 0, 1e-12);
  EXPECT_NEAR(d.y + e.y, 0, 1e-12);
  const Vec3 mirror = Difference(v, v);
  EXPECT_NEAR(mirror.z, 1, 1e-12);
  EXPECT_EQ(HalfVector(v, -v), (Vec3{0, 0, 1}));
}

// Equal areas: a grid's cell catches as many of evenly spread directions as another.
TEST(Parameterisation, TheGridIsContinuousAndOfEqualArea) {
  std::vector<int> cells(16, 0);
  constexpr int kCount = 16000;
  for (int i = 0; i < kCount; ++i) {
    const double z = (i + 0.5) / kCount, r = std::sqrt(1 - z * z), phi = 2.399963 * i;
    const auto [x, y] = GridPlace({r * std::cos(phi), r * std::sin(phi), z});
    ASSERT_TRUE(x >= 0 && x <= kGrid - 1 && y >= 0 && y <= kGrid - 1);
    const auto cell = [](float t) { return std::min(3, static_cast<int>(t / (kGrid - 1) * 4)); };
    ++cells[static_cast<size_t>(cell(y) * 4 + cell(x))];
    const auto near = GridPlace(Normalized({r * std::cos(phi + 1e-4), r * std::sin(phi + 1e-4), z}));
    EXPECT_LT(std::hypot(near[0] - x, near[1] - y), 0.01);
  }
  for (const int count : cells) EXPECT_NEAR(count, kCount / 16, kCount / 100);
}

// Müller et al. 2004, Eq. 8; Eckart and Young, texel by texel.
TEST(Svd2, IsOptimalForEveryTexel) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  const btf::BtfHeader& h = btf.header();
  for (const int terms : {1, 2, 3}) {
    double rest = 0, all = 0;
    for (size_t i = 0; i < h.texel_count(); ++i) {
      algebra::MatrixD m(h.view_count(), int64_t{3} * h.light_count());
      for (int v = 0; v < h.view_count(); ++v) {
        for (int l = 0; l < h.light_count(); ++l) {
          for (size_t c = 0; c < 3; ++c) m(v, 3 * l + static_cast<int64_t>(c)) = btf.Image(v, l)[3 * i + c];
        }
      }
      const auto svd = algebra::ThinSvd(std::move(m));
      for (size_t k = 0; k < svd->sigma.size(); ++k) {
        const double square = svd->sigma[k] * svd->sigma[k];
        all += square;
        if (k >= static_cast<size_t>(terms)) rest += square;
      }
    }
    const double best = std::sqrt(rest / all);
    EXPECT_NEAR(Error("svd2", btf, terms), best, 0.01 * best + 1e-6);
  }
}

TEST(Svd2, AllTermsReproduceTheInput) {
  EXPECT_LT(Error("svd2", SyntheticBtf(Header()), kAllTerms), 1e-5);
  EXPECT_LT(Error("svd2", SyntheticBtf(Header(), 0.2), kAllTerms), 1e-3);
}

// A product of functions of v, l and h, smooth on the grid, is what the model says: the logarithm is
// linear in its factors, and nothing but interpolation is lost.
btf::SampledBtf Product(double of_half) {
  btf::SampledBtf btf(Header());
  const btf::BtfHeader& h = btf.header();
  for (int v = 0; v < h.view_count(); ++v) {
    for (int l = 0; l < h.light_count(); ++l) {
      btf.SetPresent(v, l, true);
      auto image = btf.MutableImage(v, l);
      const Vec3 a = h.views[static_cast<size_t>(v)], b = h.lights[static_cast<size_t>(l)];
      for (size_t i = 0; i < image.size(); ++i) {
        const double t = static_cast<double>(i / 3);
        image[i] = static_cast<float>((0.5 + 0.3 * std::sin(t + 2 * v)) * (0.3 + 0.2 * std::cos(t - l)) *
                                      std::exp(of_half * HalfVector(a, b).z));
      }
    }
  }
  return btf;
}

// Müller et al. 2004, Eq. 9.
TEST(Hf, FindsProducts) {
  EncodeOptions options;
  options.floor = 1e-6;
  options.quantisation = Quantisation::kFloat;
  for (const auto& [of_half, at_most] : {std::pair{0.0, 1e-3}, {2.0, 0.04}}) {
    const btf::SampledBtf btf = Product(of_half);
    const auto encoded = (*FindEncoder("hf"))->Encode(btf, options);
    ASSERT_TRUE(encoded.ok()) << encoded.status();
    EXPECT_LT(MeasureDecoded(**encoded, btf).rel_error, at_most) << of_half;
  }
  EXPECT_GT(Error("svd2", Product(6), 1), 0.05);  // what one product of v and l cannot
}

// Müller et al. 2004, Eq. 10: another parameterisation explains what the first leaves.
TEST(Cmf, ASecondStageLowersTheError) {
  for (const btf::SampledBtf& btf : {SyntheticBtf(Header()), SyntheticBtf(Header(), 0.1), Product(6)}) {
    EXPECT_LT(Error("cmf", btf, 1), 0.95 * Error("svd2", btf, 1));
  }
}

// Texels that are multiples of two: so many clusters say what each texel's own tables say.
TEST(Cmf, AsManyClustersAsMaterialsLoseLittle) {
  btf::SampledBtf btf = SyntheticBtf(Header(), 0.1);
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      auto image = btf.MutableImage(v, l);
      for (size_t i = 6; i < image.size(); ++i) {
        image[i] = image[i % 6] * (0.2f + 0.1f * static_cast<float>(i / 6));
      }
    }
  }
  EncodeOptions options = Terms(2);
  const double each = Error("cmf", btf, 2);
  options.clusters = 1;
  EXPECT_GT(ErrorOf(**FindEncoder("cmf"), btf, options), 1.9 * each);
  options.clusters = 2;
  // Without the sweeps of both stages that tables of texels get: measured 1.3 times.
  EXPECT_LT(ErrorOf(**FindEncoder("cmf"), btf, options), 1.4 * each);
}

TEST(Cmf, AFileOfClustersIsSmallAndSaysTheSame) {
  const btf::TemporaryFolder folder;
  const btf::SampledBtf btf = SyntheticBtf(
      btf::SmallHeader(24, 16, RingDirections(2, 6, 60), RingDirections(2, 6, 60)), 0.1);
  EncodeOptions options;
  options.clusters = 5;
  const auto encoded = (*FindEncoder("cmf"))->Encode(btf, options);
  const auto whole = (*FindEncoder("cmf"))->Encode(btf, {});
  ASSERT_TRUE(encoded.ok() && whole.ok()) << encoded.status();
  EXPECT_LT(5 * *FileBytes(**encoded), *FileBytes(**whole));
  ASSERT_TRUE(WriteEncodedBtf(**encoded, folder / "c").ok());
  const auto read = ReadEncodedBtf(folder / "c");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_LT(btf::CompareBtf(DecodeAll(**read), DecodeAll(**encoded))->max_abs, 4e-6);
  const auto shader = (*read)->ToShader();
  ASSERT_TRUE(shader.has_value());
  EXPECT_EQ(shader->rgb.size() % btf.image_size(), 0u);
  options.clusters = 24 * 16 + 1;
  EXPECT_EQ((*FindEncoder("cmf"))->Encode(btf, options).status().code(),
            absl::StatusCode::kInvalidArgument);
}

TEST(Cmf, ClustersThatAreNotThereAreRefused) {
  EncodeOptions options;
  options.clusters = 3;
  const auto encoded = (*FindEncoder("cmf"))->Encode(SyntheticBtf(Header()), options);
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  for (const float bad : {-1.0f, 0.5f, 3.0f, 60000.0f}) {
    btf::CodedBtf coded;
    coded.info = (*encoded)->info();
    for (const btf::Plane& plane : (*encoded)->Planes()) coded.planes.emplace(plane.name, plane);
    coded.planes["K"].values[5] = bad;
    const Status status = (*FindDecoder("cmf"))->Decode(std::move(coded)).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_NE(std::string(Message(status)).find("part K, texel 5"), std::string::npos) << status;
  }
}

TEST(ChainFitter, NeverRaisesTheError) {
  const btf::BtfHeader h = Header();
  std::vector<uint8_t> present(h.views.size() * h.lights.size(), 1);
  for (size_t i = 0; i < present.size(); i += 7) present[i] = 0;
  ChainFitter fitter(h, present, {{Axis::kView, Axis::kLight, 2}, {Axis::kHalf, Axis::kDifference, 1}});
  std::mt19937 random(5);
  std::uniform_real_distribution<float> uniform(0.1f, 1.0f);
  std::vector<float> y(3 * fitter.pairs().size()), weights(y.size()), said(y.size());
  for (float& x : y) x = uniform(random);
  for (float& x : weights) x = uniform(random);
  std::vector<float> texel(fitter.layout().size);
  for (float& x : texel) x = uniform(random);
  const auto error = [&] {
    fitter.Evaluate(texel, said);
    double sum = 0;
    for (size_t i = 0; i < y.size(); ++i) sum += weights[i] * std::pow(y[i] - said[i], 2);
    return sum;
  };
  double before = error();
  const double start = before;
  for (int sweep = 0; sweep < 30; ++sweep) {
    fitter.Refine(y, weights, 1, 0, texel);
    const double now = error();
    EXPECT_LE(now, before * (1 + 1e-5));
    before = now;
  }
  EXPECT_LT(before, 0.5 * start);
}

// The coarsest level of a material decodes to about the mean of all its texels.
TEST(ChainMips, CoarsestLevelIsTheMean) {
  const btf::SampledBtf btf = SyntheticBtf(
      btf::SmallHeader(4, 4, RingDirections(1, 5, 50), RingDirections(1, 5, 50)), 0.1);
  for (const char* codec : {"svd2", "hf", "cmf"}) {
    const auto encoded = (*FindEncoder(codec))->Encode(btf, {});
    ASSERT_TRUE(encoded.ok()) << encoded.status();
    const ChainFactors& f = static_cast<const ChainBtf&>(**encoded).factors();
    const Layout& layout = static_cast<const ChainBtf&>(**encoded).layout();
    const ChainMips mips = FitMips((*encoded)->info(), f);
    ASSERT_EQ(mips.values.size(), (4u + 1) * layout.size);
    ASSERT_EQ(mips.scales.size(), (4u + 1) * f.stages.size());
    std::vector<float> image(btf.image_size());
    double error = 0, norm = 0;
    for (int v = 0; v < btf.header().view_count(); ++v) {
      for (int l = 0; l < btf.header().light_count(); ++l) {
        if (!btf.Present(v, l)) continue;
        (*encoded)->DecodeImage(v, l, image);
        const auto rgb = ProductOf(f.stages, layout, TapsOf(f.stages, btf.header(), v, l),
                                   {mips.values.data() + 4 * layout.size,
                                    mips.values.data() + 4 * layout.size},
                                   mips.scales.data() + 4 * f.stages.size());
        for (size_t c = 0; c < 3; ++c) {
          double mean = 0;
          for (size_t i = c; i < image.size(); i += 3) mean += image[i] / 16;
          error += std::pow(rgb[c] - f.floor - mean, 2), norm += mean * mean;
        }
      }
    }
    EXPECT_LT(std::sqrt(error / norm), 0.03) << codec;
  }
}

}  // namespace
}  // namespace mesorig::codecs::per_texel
