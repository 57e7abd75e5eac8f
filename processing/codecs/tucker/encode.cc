#include <algorithm>
#include <cmath>

#include "processing/codecs/linear/linear_encoder.h"
#include "processing/codecs/tucker/core_tensor.h"
#include "processing/codecs/tucker/tucker.h"

namespace mesorig::codecs::tucker {
namespace {

constexpr int kDefaultTerms = 16;
// Of the energy that the texel terms lost, what each of the two other modes may lose.
constexpr double kLoss = 0.03;
constexpr size_t kMostSide = 6144;  // views, or channels of lights: a Gram matrix of 300 MB

// What the texel mode leaves: sigma V^T over views and (light, channel), in the weights' unit.
Tensor Rest(const btf::BtfHeader& h, const AbrdfMatrix& matrix, const algebra::TruncatedSvd& svd) {
  Tensor t;
  t.terms = static_cast<int64_t>(svd.sigma.size());
  t.views = h.view_count();
  t.rows = 3 * h.light_count();
  t.values.assign(static_cast<size_t>(t.terms * t.views * t.rows), 0.0f);
  t.present.assign(static_cast<size_t>(t.views * t.rows), 0);
  for (int64_t j = 0; j < matrix.cols(); ++j) {
    const size_t at = 3 * matrix.pairs()[static_cast<size_t>(j) / 3] + static_cast<size_t>(j) % 3;
    t.present[at] = 1;
    for (int64_t a = 0; a < t.terms; ++a) {
      t.Slice(a)[at] = static_cast<float>(svd.sigma[static_cast<size_t>(a)] * svd.v(j, a));
    }
  }
  return t;
}

float Largest(std::span<const float> values) {
  float largest = 0;
  for (const float x : values) largest = std::max(largest, std::abs(x));
  return largest;
}

// Brings `values` into [-1, 1] by a power of two; returns what they were divided by.
float Balance(std::span<float> values) {
  const float scale = ScaleFor(Largest(values));
  for (float& x : values) x /= scale;
  return scale;
}

// The modes without the weights, each row of directions a texel's term could multiply.
Core CoreOf(const Modes& modes, const SeparateWeights& weights, int64_t terms, Quantisation of_g) {
  Core core;
  core.terms = static_cast<int>(terms);
  core.view_terms = static_cast<int>(modes.views.cols);
  core.light_terms = static_cast<int>(modes.rows.cols);
  for (int64_t v = 0; v < modes.views.rows; ++v) {
    for (int64_t b = 0; b < modes.views.cols; ++b) {
      core.views.push_back(modes.views(v, b) / weights.view[static_cast<size_t>(v)]);
    }
  }
  for (int64_t r = 0; r < modes.rows.rows; ++r) {
    for (int64_t c = 0; c < modes.rows.cols; ++c) {
      core.lights.push_back(modes.rows(r, c) / weights.light[static_cast<size_t>(r / 3)]);
    }
  }
  const float scale = Balance(core.views) * Balance(core.lights);
  core.values = modes.core;
  const size_t slice = core.values.size() / static_cast<size_t>(terms);
  for (int64_t a = 0; a < terms; ++a) {
    core.scales.push_back(
        scale * Balance(std::span(core.values).subspan(static_cast<size_t>(a) * slice, slice)));
  }
  const Quantisation small = OfCore(of_g);
  RoundTo(small, core.views);
  RoundTo(small, core.lights);
  RoundTo(small, core.values);
  return core;
}

// U without the texels' weights, terms balanced into core.scales, rounded.
std::vector<float> TexelTerms(const AbrdfMatrix& matrix, const algebra::MatrixF& u, size_t stride,
                              Quantisation quantisation, Core& core) {
  std::vector<float> g(static_cast<size_t>(u.rows) * stride, 0.0f);
  for (int64_t a = 0; a < core.terms; ++a) {
    float largest = 0;
    for (int64_t i = 0; i < u.rows; ++i) {
      largest = std::max(largest, std::abs(u(i, a) / matrix.TexelWeight(i)));
    }
    const float scale = ScaleFor(largest);
    for (int64_t i = 0; i < u.rows; ++i) {
      g[static_cast<size_t>(i) * stride + static_cast<size_t>(a)] =
          u(i, a) / matrix.TexelWeight(i) / scale;
    }
    float& s = core.scales[static_cast<size_t>(a)];
    s = std::clamp(s * scale, 0x1p-100f, 0x1p100f);
  }
  RoundTo(quantisation, g);
  return g;
}

class TuckerEncoder final : public Encoder {
 public:
  std::string_view name() const override { return kName; }
  unsigned options() const override { return kWeighting | kLogWeighting | kQuantisation; }
  int max_terms(const btf::SampledBtf& btf) const override {
    return MostLinearTerms(MemorySource(btf));
  }

  StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                   const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
    MESORIG_ASSIGN_OR_RETURN(const SeparateWeights weights, SeparateWeightsFor(source, options));
    return Factorise(source, weights, options);
  }

 private:
  StatusOr<std::unique_ptr<EncodedBtf>> Factorise(const SampleSource& source,
                                                  const SeparateWeights& separate,
                                                  const EncodeOptions& options) const {
    const btf::BtfHeader& h = source.header();
    if (std::max(h.views.size(), 3 * h.lights.size()) > kMostSide) {
      return InvalidArgument("{} views and {} lights, at most {} and {} are taken", h.view_count(),
                             h.light_count(), kMostSide, kMostSide / 3);
    }
    MESORIG_ASSIGN_OR_RETURN(const int terms,
                             TermsOf(options, kDefaultTerms, MostLinearTerms(source)));
    const SampleWeights weights = Product(separate);
    const AbrdfMatrix matrix(source, weights, options.weighting);
    MESORIG_ASSIGN_OR_RETURN(const algebra::TruncatedSvd svd,
                             algebra::DecomposeTruncated(matrix, SvdOptionsFor(options, terms)));
    const double lost = std::pow(svd.residual * svd.norm, 2);
    MESORIG_ASSIGN_OR_RETURN(
        const Modes modes,
        DecomposeModes(Rest(h, matrix, svd), options.terms == kAllTerms ? 0 : kLoss * lost));
    const Quantisation quantisation = QuantisationOf(options);
    Core core = CoreOf(modes, separate, terms, quantisation);
    LinearShape shape;
    shape.terms = core.terms;
    std::vector<float> g = TexelTerms(matrix, svd.u, static_cast<size_t>(shape.stride()),
                                      quantisation, core);
    btf::BtfFileInfo info = InfoOf(source, name(), kVersion);
    info.codec_options_json = OptionsJson(options, quantisation, weights.floor,
                                          {{"terms", core.terms},
                                           {"view_terms", core.view_terms},
                                           {"light_terms", core.light_terms}});
    const float floor = options.weighting == Weighting::kLog ? static_cast<float>(weights.floor) : 0;
    return TuckerBtf::Create(std::move(info), std::move(core), quantisation, floor, std::move(g));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const TuckerEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::tucker
