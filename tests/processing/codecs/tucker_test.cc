// tucker: its modes, and what it owes beside the linear bases (linear_bases_test.cc).

#include "processing/codecs/tucker/tucker.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "processing/btf/errors.h"
#include "processing/codecs/encoder.h"
#include "processing/codecs/target.h"
#include "processing/codecs/tucker/core_tensor.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::codecs::tucker {
namespace {

using btf::RingDirections;
using btf::SyntheticBtf;

// Of multilinear rank (terms, 2, 3): a random core between random vectors.
Tensor LowRank(int64_t terms, int64_t views, int64_t rows) {
  std::mt19937 random(4);
  std::normal_distribution<float> normal;
  const auto vectors = [&](int64_t n, int64_t k) {
    algebra::MatrixF m(n, k);
    for (float& x : m.values) x = normal(random);
    return m;
  };
  const algebra::MatrixF v = vectors(views, 2), r = vectors(rows, 3);
  Tensor t;
  t.terms = terms, t.views = views, t.rows = rows;
  for (int64_t a = 0; a < terms; ++a) {
    const algebra::MatrixF slice =
        algebra::Multiply(algebra::Multiply(r, false, vectors(3, 2), false), false, v, true);
    t.values.insert(t.values.end(), slice.values.begin(), slice.values.end());
  }
  return t;
}

// The largest |t - what the modes say of it|, absent entries included.
double WorstError(const Tensor& t, const Modes& m) {
  double worst = 0;
  const auto view_terms = m.views.cols, row_terms = m.rows.cols;
  for (int64_t a = 0; a < t.terms; ++a) {
    for (int64_t v = 0; v < t.views; ++v) {
      for (int64_t r = 0; r < t.rows; ++r) {
        double sum = 0;
        for (int64_t b = 0; b < view_terms; ++b) {
          for (int64_t c = 0; c < row_terms; ++c) {
            sum += static_cast<double>(
                       m.core[static_cast<size_t>((a * view_terms + b) * row_terms + c)]) *
                   m.views(v, b) * m.rows(r, c);
          }
        }
        worst = std::max(worst, std::abs(sum - t.Slice(a)[v * t.rows + r]));
      }
    }
  }
  return worst;
}

double Energy(const Tensor& t) {
  double sum = 0;
  for (const float x : t.values) sum += static_cast<double>(x) * x;
  return sum;
}

TEST(CoreTensor, FindsTheRanksThatThereAre) {
  const Tensor t = LowRank(4, 12, 20);
  const auto modes = DecomposeModes(t, 1e-6 * Energy(t));
  ASSERT_TRUE(modes.ok()) << modes.status();
  EXPECT_EQ(modes->views.cols, 2);
  EXPECT_EQ(modes->rows.cols, 3);
  EXPECT_LT(algebra::OrthogonalityError(modes->views), 1e-6);
  EXPECT_LT(algebra::OrthogonalityError(modes->rows), 1e-6);
  EXPECT_LT(WorstError(t, *modes), 1e-4);
  const auto all = DecomposeModes(t, 0);
  ASSERT_TRUE(all.ok());
  EXPECT_EQ(all->views.cols, 12);
  EXPECT_EQ(all->rows.cols, 20);
  EXPECT_LT(WorstError(t, *all), 1e-4);
}

TEST(CoreTensor, StaysWithinItsBudget) {
  std::mt19937 random(9);
  std::normal_distribution<float> normal;
  Tensor t = LowRank(5, 14, 18);
  for (float& x : t.values) x += 0.3f * normal(random);
  for (const double part : {0.01, 0.05, 0.2}) {
    const auto m = DecomposeModes(t, part * Energy(t));
    ASSERT_TRUE(m.ok());
    double kept = 0;
    for (const float x : m->core) kept += static_cast<double>(x) * x;
    EXPECT_LE(Energy(t) - kept, 2 * part * Energy(t)) << part;
  }
}

// A tenth of the entries absent, and nonsense where they are: they come back as what they were.
TEST(CoreTensor, FillsInWhatIsAbsent) {
  const Tensor truth = LowRank(4, 12, 20);
  Tensor t = truth;
  std::mt19937 random(2);
  t.present.assign(12 * 20, 1);
  for (size_t i = 0; i < t.present.size(); ++i) {
    if (random() % 10 != 0) continue;
    t.present[i] = 0;
    for (int64_t a = 0; a < t.terms; ++a) t.Slice(a)[i] = 1e6f;
  }
  const auto modes = DecomposeModes(t, 1e-3 * Energy(truth));
  ASSERT_TRUE(modes.ok()) << modes.status();
  EXPECT_LT(WorstError(truth, *modes), 0.2 * std::sqrt(Energy(truth) / 960));
}

TEST(CoreTensor, AllZero) {
  Tensor t = LowRank(2, 3, 6);
  std::fill(t.values.begin(), t.values.end(), 0.0f);
  const auto modes = DecomposeModes(t, 1e-3);
  ASSERT_TRUE(modes.ok());
  EXPECT_EQ(WorstError(t, *modes), 0);
}

btf::BtfHeader Header() {
  return btf::SmallHeader(16, 12, RingDirections(3, 8, 70), RingDirections(3, 8, 70));
}

std::unique_ptr<EncodedBtf> Encoded(std::string_view codec, const btf::SampledBtf& btf,
                                    const EncodeOptions& options) {
  auto encoded = (*FindEncoder(codec))->Encode(btf, options);
  EXPECT_TRUE(encoded.ok()) << encoded.status();
  return *std::move(encoded);
}

// Vasilescu and Terzopoulos: the directions' vectors cost less, and next to no error.
TEST(Tucker, IsSmallerThanFmfAtHardlyMoreError) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  for (const int terms : {2, 4, 8}) {
    EncodeOptions options;
    options.terms = terms;
    const auto tucker = Encoded(kName, btf, options), fmf = Encoded("fmf", btf, options);
    EXPECT_LT(MeasureDecoded(*tucker, btf).rel_error,
              1.035 * MeasureDecoded(*fmf, btf).rel_error + 5e-4)
        << terms;
    if (terms <= 2) {
      EXPECT_LT(*FileBytes(*tucker), *FileBytes(*fmf)) << terms;
    }
  }
}

TEST(Tucker, AbsentPairsDoNotSpoilThePresentOnes) {
  const btf::SampledBtf full = SyntheticBtf(Header()), holes = SyntheticBtf(Header(), 0.2);
  EncodeOptions options;
  options.terms = 6;
  EXPECT_LT(MeasureDecoded(*Encoded(kName, holes, options), holes).rel_error,
            1.2 * MeasureDecoded(*Encoded(kName, full, options), full).rel_error + 1e-3);
}

TEST(Tucker, ScalesStayInTheFileAtAnySize) {
  btf::SampledBtf btf = SyntheticBtf(Header());
  for (const float scale : {1e-12f, 1e9f}) {
    btf::SampledBtf scaled = btf;
    for (int v = 0; v < btf.header().view_count(); ++v) {
      for (int l = 0; l < btf.header().light_count(); ++l) {
        for (float& x : scaled.MutableImage(v, l)) x *= scale;
      }
    }
    EXPECT_NEAR(MeasureDecoded(*Encoded(kName, scaled, {}), scaled).rel_error,
                MeasureDecoded(*Encoded(kName, btf, {}), btf).rel_error, 1e-3);
  }
}

// A small file that would be multiplied out to more than memory is refused before it is.
TEST(Tucker, RefusesVectorsThatDoNotFit) {
  btf::BtfFileInfo info;
  info.header = btf::SmallHeader(1, 1, RingDirections(100, 100, 80), RingDirections(100, 100, 80));
  info.present.assign(info.header.views.size() * info.header.lights.size(), 1);
  Core core;
  core.terms = core.view_terms = core.light_terms = 1;
  core.views.assign(info.header.views.size(), 1.0f);
  core.lights.assign(3 * info.header.lights.size(), 1.0f);
  core.values = core.scales = {1.0f};
  const auto refused = TuckerBtf::Create(info, core, Quantisation::kHalf, 0, {1, 0, 0, 0});
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(std::string(Message(refused.status())).find("GiB"), std::string::npos);
}

}  // namespace
}  // namespace mesorig::codecs::tucker
