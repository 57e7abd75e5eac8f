#include "processing/codecs/linear/pack_factors.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace mesorig::codecs {
namespace {

// Which basis the weights of (family, texel) belong to.
size_t BasisOf(const LinearFactors& factors, size_t family, size_t texel) {
  if (factors.shape.per_view) return family;
  return factors.cluster.empty() ? 0 : factors.cluster[texel];
}

}  // namespace

LinearFactors EmptyFactors(const btf::BtfHeader& header, const LinearShape& shape) {
  const auto stride = static_cast<size_t>(shape.stride());
  const auto families = static_cast<size_t>(shape.families(header));
  const auto bases = static_cast<size_t>(shape.bases(header));
  LinearFactors factors;
  factors.shape = shape;
  factors.g.assign(families * header.texel_count() * stride, 0.0f);
  for (size_t i = 0; shape.mean && i < families * header.texel_count(); ++i) {
    factors.g[i * stride + static_cast<size_t>(shape.terms)] = 1;
  }
  factors.h.assign(bases * shape.pairs(header) * 3 * stride, 0.0f);
  factors.scales.assign(bases * stride, 1.0f);
  return factors;
}

void PutTerms(const AbrdfMatrix& matrix, const algebra::TruncatedSvd& svd,
              std::span<const float> mean, int family, int basis, const btf::BtfHeader& header,
              LinearFactors& factors) {
  const LinearShape& shape = factors.shape;
  const auto stride = static_cast<size_t>(shape.stride());
  const size_t pairs = shape.pairs(header);
  const auto used = std::min<int64_t>(shape.terms, static_cast<int64_t>(svd.sigma.size()));
  float* const g = factors.g.data() + static_cast<size_t>(family) * header.texel_count() * stride;
  for (int64_t i = 0; i < matrix.rows(); ++i) {
    float* const to = g + matrix.texels()[static_cast<size_t>(i)] * stride;
    for (int64_t k = 0; k < used; ++k) {
      to[k] = static_cast<float>(svd.u(i, k) * svd.sigma[static_cast<size_t>(k)] /
                                 matrix.TexelWeight(i));
    }
  }
  float* const h = factors.h.data() + static_cast<size_t>(basis) * pairs * 3 * stride;
  for (int64_t j = 0; j < matrix.cols(); ++j) {
    const auto at = static_cast<size_t>(j);
    float* const to = h + (matrix.pairs()[at / 3] % pairs * 3 + at % 3) * stride;
    const float weight = matrix.ColumnWeight(j);
    for (int64_t k = 0; k < used; ++k) to[k] = svd.v(j, k) / weight;
    if (!mean.empty()) to[shape.terms] = mean[at] / weight;
  }
}

void RoundFactors(const btf::BtfHeader& header, LinearFactors& factors) {
  const LinearShape& shape = factors.shape;
  const auto stride = static_cast<size_t>(shape.stride()), texels = header.texel_count();
  const auto families = static_cast<size_t>(shape.families(header));
  const auto bases = static_cast<size_t>(shape.bases(header));
  const size_t terms = static_cast<size_t>(shape.terms), rows = shape.pairs(header) * 3;
  const auto for_g = [&](const auto& function) {
    for (size_t i = 0; i < families * texels; ++i) {
      const size_t first = BasisOf(factors, i / texels, i % texels) * stride;
      for (size_t k = 0; k < terms; ++k) function(first + k, factors.g[i * stride + k]);
    }
  };
  const auto for_h = [&](const auto& function) {
    for (size_t i = 0; i < bases * rows; ++i) {
      for (size_t k = 0; k < stride; ++k) function(i / rows * stride + k, factors.h[i * stride + k]);
    }
  };
  std::vector<float> scale(bases * stride, 0.0f);
  const auto find = [&](size_t k, float x) { scale[k] = std::max(scale[k], std::abs(x)); };
  const auto to_powers = [&] {
    std::transform(scale.begin(), scale.end(), scale.begin(), ScaleFor);
  };
  for_g(find);
  to_powers();
  for_g([&](size_t k, float& x) { x /= scale[k]; });
  for_h([&](size_t k, float& x) { x *= scale[k]; });
  std::fill(scale.begin(), scale.end(), 0.0f);
  for_h(find);
  to_powers();
  for_h([&](size_t k, float& x) { x /= scale[k]; });
  RoundTo(factors.quantisation, factors.g);
  RoundTo(factors.quantisation, factors.h);
  for_h([&](size_t k, float& x) { x *= scale[k]; });
  factors.scales = std::move(scale);
}

Quantisation QuantisationOf(const EncodeOptions& options) {
  return options.quantisation.value_or(options.terms == kAllTerms ? Quantisation::kFloat
                                                                  : Quantisation::kHalf);
}

std::string OptionsJson(const EncodeOptions& options, Quantisation quantisation, double floor,
                        const std::vector<std::pair<std::string, int>>& counts) {
  nlohmann::json json{{"weighting", NameOf(options.weighting)},
                      {"solid_angle", options.solid_angle},
                      {"variance", options.variance},
                      {"quantisation", NameOf(quantisation)}};
  for (const auto& [what, count] : counts) json[what] = count;
  if (options.weighting != Weighting::kLinear) json["floor"] = floor;
  return json.dump();
}

StatusOr<int> TermsOf(const EncodeOptions& options, int standard, int most) {
  int terms = options.terms == kAllTerms ? most : options.terms;
  if (terms == 0) terms = std::min(standard, most);
  if (terms < 1 || terms > most) {
    return InvalidArgument("{} terms, permitted are 1 to {} or all", terms, most);
  }
  return terms;
}

}  // namespace mesorig::codecs
