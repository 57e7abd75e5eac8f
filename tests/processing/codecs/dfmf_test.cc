// dfmf: its colours, and what it owes beside the contract and stability_test.cc.

#include <gtest/gtest.h>

#include <cmath>

#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/linear_btf.h"
#include "processing/codecs/target.h"
#include "tests/processing/btf/synthetic.h"
#include "tests/processing/codecs/encoding.h"

namespace mesorig::codecs {
namespace {

using btf::RingDirections;
using btf::SyntheticBtf;

btf::BtfHeader Header() {
  return btf::SmallHeader(8, 6, RingDirections(2, 6, 60), RingDirections(2, 8, 60));
}

double Error(std::string_view codec, const btf::SampledBtf& btf, int terms) {
  return ErrorOf(**FindEncoder(codec), btf, Terms(terms));
}

TEST(Decorrelated, ThereAndBack) {
  for (const std::array<float, 3>& rgb :
       {std::array<float, 3>{0.3f, 0.2f, 0.1f}, {0, 0, 0}, {5, 0, 0}, {1e-6f, 2e-6f, 3e-6f}}) {
    const auto back = FromDecorrelated(ToDecorrelated(rgb.data(), 0.01f), 0.01f);
    for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(back[c], rgb[c], 1e-6 + 1e-5 * rgb[c]);
  }
  // Grey has no colour, and what is e times brighter differs by one in the first channel alone.
  const float grey[] = {0.5f, 0.5f, 0.5f};
  EXPECT_NEAR(ToDecorrelated(grey, 0.1f)[1], 0, 1e-6);
  EXPECT_NEAR(ToDecorrelated(grey, 0.1f)[2], 0, 1e-6);
  const float red[] = {0.6f, 0.2f, 0.1f}, bright[] = {0.6f * 2.7182818f, 0.2f * 2.7182818f, 0.1f * 2.7182818f};
  EXPECT_NEAR(ToDecorrelated(bright, 1e-9f)[0] - ToDecorrelated(red, 1e-9f)[0], 1, 1e-5);
  EXPECT_NEAR(ToDecorrelated(bright, 1e-9f)[2], ToDecorrelated(red, 1e-9f)[2], 1e-5);
}

TEST(Dfmf, AllTermsReproduceTheInput) {
  EXPECT_LT(Error("dfmf", SyntheticBtf(Header()), kAllTerms), 1e-4);
  EXPECT_LT(Error("dfmf", SyntheticBtf(Header(), 0.2), kAllTerms), 1e-4);
}

// One texture times one function of the directions, each texel of its own colour: one luma term and one
// of each colour say it all.
TEST(Dfmf, ColoursThatDoNotChangeCostOneTerm) {
  btf::SampledBtf btf(Header());
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      btf.SetPresent(v, l, true);
      auto image = btf.MutableImage(v, l);
      for (size_t i = 0; i < image.size(); ++i) {
        const double t = static_cast<double>(i / 3);
        image[i] = static_cast<float>((0.4 + 0.3 * std::sin(t + static_cast<double>(i % 3))) *
                                      std::exp(1.5 * std::sin(v + 2.0 * l)));
      }
    }
  }
  EncodeOptions options;
  options.terms = 2;  // log(texture) + log(function) has rank two
  options.floor = 1e-6;
  const auto encoded = (*FindEncoder("dfmf"))->Encode(btf, options);
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  EXPECT_LT(MeasureDecoded(**encoded, btf).rel_error, 5e-3);
}

TEST(Dfmf, MoreTermsLessError) {
  const btf::SampledBtf btf = SyntheticBtf(Header());
  double before = 1;
  for (const int terms : {1, 4, 12}) {
    const double error = Error("dfmf", btf, terms);
    EXPECT_LT(error, before);
    before = error;
  }
  EXPECT_LT(before, 0.05);
}

}  // namespace
}  // namespace mesorig::codecs
