#include "processing/codecs/rf_ptm/rf_ptm.h"

#include <gtest/gtest.h>

#include "processing/btf/errors.h"
#include "processing/codecs/encoder.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::codecs::rf_ptm {
namespace {

using btf::RingDirections;

std::unique_ptr<EncodedBtf> Encoded(const btf::SampledBtf& btf, double regularisation = -1) {
  EncodeOptions options;
  options.regularisation = regularisation;
  auto encoded = (*FindEncoder(kName))->Encode(btf, options);
  EXPECT_TRUE(encoded.ok()) << encoded.status();
  return *std::move(encoded);
}

template <typename Function>
btf::SampledBtf Filled(const btf::BtfHeader& header, const Function& value) {
  btf::SampledBtf btf(header);
  for (int v = 0; v < header.view_count(); ++v) {
    for (int l = 0; l < header.light_count(); ++l) {
      btf.SetPresent(v, l, true);
      auto image = btf.MutableImage(v, l);
      for (size_t i = 0; i < image.size(); ++i) {
        image[i] = static_cast<float>(value(i, header.lights[static_cast<size_t>(l)]));
      }
    }
  }
  return btf;
}

double Biquadratic(size_t i, Vec3 l) {
  const double s = 0.1 * std::sin(static_cast<double>(i));
  return 1 + s + (0.3 - s) * l.x * l.x - 0.2 * l.y * l.y + s * l.x * l.y + 0.15 * l.x - 0.1 * l.y;
}

// Malzbender et al. 2001, Eq. 5: what has this form is found.
TEST(RfPtm, ExactOnABiquadratic) {
  const btf::SampledBtf btf = Filled(
      btf::SmallHeader(5, 4, RingDirections(1, 3, 40), RingDirections(2, 8, 60)), Biquadratic);
  const auto encoded = Encoded(btf, 0);
  EXPECT_LT(btf::CompareBtf(DecodeAll(*encoded), btf)->rel_error, 1e-3);  // half
  std::vector<float> image(btf.image_size());
  const Vec3 l = DirectionFromAngles(0.4, 2.2);  // not measured
  ASSERT_TRUE(encoded->PredictImage(1, l, image).ok());
  for (size_t i = 0; i < image.size(); ++i) EXPECT_NEAR(image[i], Biquadratic(i, l), 2e-3);
}

// Lambert's law is what the regulariser leaves alone, however strong it is.
TEST(RfPtm, StrongRegularisationIsLambert) {
  const auto lambert = [](size_t i, Vec3 l) {
    return 0.5 * Dot(Normalized({0.3 * std::sin(static_cast<double>(i)), 0.1, 1}), l);
  };
  const btf::SampledBtf btf =
      Filled(btf::SmallHeader(5, 4, {{0, 0, 1}}, RingDirections(2, 6, 39)), lambert);
  EXPECT_LT(btf::CompareBtf(DecodeAll(*Encoded(btf, 1e6)), btf)->rel_error, 0.01);
}

TEST(RfPtm, FewOrCollinearLightsGiveFiniteImages) {
  const std::vector<std::vector<Vec3>> sets = {
      {{0, 0, 1}},
      {{0.6, 0, 0.8}},
      {{0, 0, 1}, {0.6, 0, 0.8}},
      {{0, 0, 1}, {0.6, 0, 0.8}, {-0.6, 0, 0.8}, {0.28, 0, 0.96}, {-0.28, 0, 0.96}},
  };
  for (const auto& lights : sets) {
    const btf::SampledBtf btf =
        Filled(btf::SmallHeader(3, 2, {{0, 0, 1}}, lights), [](size_t i, Vec3 l) {
          return (0.2 + 0.1 * static_cast<double>(i)) * l.z;
        });
    for (const double regularisation : {0.0, -1.0}) {
      const auto encoded = Encoded(btf, regularisation);
      EXPECT_LT(btf::CompareBtf(DecodeAll(*encoded), btf)->rel_error, 0.02) << lights.size();
      std::vector<float> image(btf.image_size());
      ASSERT_TRUE(encoded->PredictImage(0, {0, 0.6, 0.8}, image).ok());
      for (const float x : image) EXPECT_TRUE(std::isfinite(x) && std::abs(x) < 10);
    }
  }
}

// One photograph of a stack whose lamp stood elsewhere must not spoil the others.
TEST(RfPtm, ALightThatLiesIsFoundOut) {
  btf::BtfHeader header = btf::SmallHeader(6, 6, {{0, 0, 1}}, RingDirections(2, 6, 39));
  header.calibrated = false;
  const auto lambert = [](size_t i, Vec3 l) {
    const auto t = static_cast<double>(i / 3);
    return 0.6 * Dot(Normalized({0.4 * std::sin(t), 0.4 * std::cos(1.7 * t), 1}), l);
  };
  btf::SampledBtf honest = Filled(header, lambert), liar = honest;
  auto image = liar.MutableImage(0, 4);
  for (size_t i = 0; i < image.size(); ++i) {
    image[i] = static_cast<float>(0.6 * lambert(i, {-0.5, 0.3, 0.8}));
  }
  btf::SampledBtf trusting = liar;
  trusting.mutable_header().calibrated = true;
  honest.SetPresent(0, 4, false);
  const double doubted = btf::CompareBtf(DecodeAll(*Encoded(liar)), honest)->rel_error;
  const double trusted = btf::CompareBtf(DecodeAll(*Encoded(trusting)), honest)->rel_error;
  EXPECT_LT(doubted, 0.3 * trusted);
}

}  // namespace
}  // namespace mesorig::codecs::rf_ptm
