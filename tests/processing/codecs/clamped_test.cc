// The non-negativity policy, for every codec.

#include "processing/codecs/clamped.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "processing/btf/errors.h"
#include "tests/processing/btf/synthetic.h"
#include "tests/processing/codecs/encoding.h"

namespace mesorig::codecs {
namespace {

using btf::RingDirections;

// A spot of light in the dark at every texel: few terms overshoot below zero beside it.
btf::SampledBtf Spots() {
  btf::SampledBtf btf(
      btf::SmallHeader(6, 5, RingDirections(2, 6, 60), RingDirections(2, 7, 60)));
  const btf::BtfHeader& h = btf.header();
  for (int v = 0; v < h.view_count(); ++v) {
    for (int l = 0; l < h.light_count(); ++l) {
      btf.SetPresent(v, l, true);
      auto image = btf.MutableImage(v, l);
      for (size_t i = 0; i < image.size(); ++i) {
        image[i] = (static_cast<size_t>(3 * v + 5 * l) + i / 3) % 11 < 2 ? 0.5f : 0.001f;
      }
    }
  }
  return btf;
}

class Negative : public ::testing::TestWithParam<const Encoder*> {
 protected:
  std::unique_ptr<EncodedBtf> Encode(bool clamp) const {
    EncodeOptions options;
    options.clamp_negative = clamp;
    if (GetParam()->max_terms(Spots()) > 3) options.terms = 3;
    return EncodeBtf(*GetParam(), Spots(), options).value();
  }
};

TEST_P(Negative, ClampedIsTheSameButForWhatIsBelowZero) {
  const auto kept = Encode(false), clamped = Encode(true);
  const btf::SampledBtf a = DecodeAll(*kept), b = DecodeAll(*clamped);
  for (int v = 0; v < a.header().view_count(); ++v) {
    for (int l = 0; l < a.header().light_count(); ++l) {
      for (size_t i = 0; i < a.image_size(); ++i) {
        ASSERT_EQ(b.Image(v, l)[i], std::max(a.Image(v, l)[i], 0.0f));
      }
      const Vec3 view = Normalized(a.header().views[static_cast<size_t>(v)] + Vec3{0.1, 0, 0});
      const Vec3 light = a.header().lights[static_cast<size_t>(l)];
      const auto x = kept->Evaluate(3, 2, view, light), y = clamped->Evaluate(3, 2, view, light);
      for (size_t c = 0; c < 3; ++c) ASSERT_EQ(y[c], std::max(x[c], 0.0f));
    }
  }
}

TEST_P(Negative, TheMassIsReportedEitherWayAndClampingLowersTheError) {
  const btf::SampledBtf btf = Spots();
  const DecodedErrors kept = MeasureDecoded(*Encode(false), btf);
  const DecodedErrors clamped = MeasureDecoded(*Encode(true), btf);
  EXPECT_EQ(kept.clamped_mass, clamped.clamped_mass);
  EXPECT_LE(clamped.rel_error, kept.rel_error);
  if (kept.clamped_mass > 0) {
    EXPECT_LT(clamped.rel_error, kept.rel_error);
  }
  if (GetParam()->name() == "fmf" || GetParam()->name() == "view-svd") {
    EXPECT_GT(kept.clamped_mass, 0.01);
  }
}

TEST_P(Negative, TheFileSaysIt) {
  btf::TemporaryFolder folder;
  for (const bool clamp : {false, true}) {
    const auto encoded = Encode(clamp);
    ASSERT_TRUE(WriteEncodedBtf(*encoded, folder / "c").ok());
    const auto read = ReadEncodedBtf(folder / "c");
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_EQ((*read)->info().clamp_negative, clamp);
    const btf::SampledBtf decoded = DecodeAll(**read);
    // Directions are stored as float: what is looked up between nodes moves by some ulps.
    EXPECT_LT(btf::CompareBtf(decoded, DecodeAll(*encoded))->max_abs, 4e-6);
    const auto shader = (*read)->ToShader();
    if (shader) {
      EXPECT_EQ(shader->glsl.find("vec3 DecodeSigned(") != std::string::npos, clamp);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Registry, Negative, ::testing::ValuesIn(AllEncoders()), CodecOfTest);

}  // namespace
}  // namespace mesorig::codecs
