#include "processing/codecs/linear/linear_encoder.h"

#include <algorithm>
#include <cmath>

namespace mesorig::codecs {
namespace {

constexpr int kMaxTerms = 4096;

std::vector<float> Roots(const std::vector<double>& weights) {
  std::vector<float> roots;
  for (const double w : weights) roots.push_back(static_cast<float>(std::sqrt(w)));
  return roots;
}

}  // namespace

SampleWeights Product(const SeparateWeights& w) {
  SampleWeights product{w.texel, {}, w.floor};
  for (const float view : w.view) {
    for (const float light : w.light) product.sample.insert(product.sample.end(), 3, view * light);
  }
  return product;
}

StatusOr<SeparateWeights> WeightsOfDirections(const SampleSource& source,
                                              const EncodeOptions& options) {
  if (options.weighting != Weighting::kLinear) {
    return Unimplemented("{} weighting of a BTF that is not held in memory", NameOf(options.weighting));
  }
  if (options.variance) return Unimplemented("weights from variances of a BTF that is not held in memory");
  const btf::BtfHeader& h = source.header();
  SeparateWeights w{std::vector<float>(h.views.size(), 1.0f),
                    std::vector<float>(h.lights.size(), 1.0f),
                    std::vector<float>(h.texel_count(), 1.0f)};
  w.plain = !options.solid_angle && h.mask.empty();
  for (size_t i = 0; i < w.texel.size(); ++i) {
    if (!h.InMask(i)) w.texel[i] = kOutsideMask;
  }
  if (options.solid_angle) {
    w.view = Roots(SolidAngleWeights(h.views));
    w.light = Roots(SolidAngleWeights(h.lights));
  }
  return w;
}

int MostLinearTerms(const SampleSource& source) {
  return static_cast<int>(std::min<size_t>(
      {kMaxTerms, source.header().texel_count(), 3 * source.Pairs().size()}));
}

algebra::SvdOptions SvdOptionsFor(const EncodeOptions& options, int64_t rank) {
  algebra::SvdOptions svd_options;
  svd_options.rank = rank;
  svd_options.block_bytes = options.block_bytes;
  return svd_options;
}

LinearFactors FactorsFor(const btf::BtfHeader& header, const LinearShape& shape,
                         const SampleWeights& weights, const EncodeOptions& options) {
  LinearFactors factors = EmptyFactors(header, shape);
  factors.quantisation = QuantisationOf(options);
  if (options.weighting == Weighting::kLog) factors.log_floor = static_cast<float>(weights.floor);
  return factors;
}

int LinearEncoder::max_terms(const btf::SampledBtf& btf) const {
  return MostLinearTerms(MemorySource(btf));
}

StatusOr<std::unique_ptr<EncodedBtf>> LinearEncoder::Encode(const btf::SampledBtf& btf,
                                                            const EncodeOptions& options) const {
  MESORIG_RETURN_IF_ERROR(CheckEncodable(btf, options, *this));
  return Factorise(MemorySource(btf), WeightsFor(btf, options), options);
}

StatusOr<std::unique_ptr<EncodedBtf>> LinearEncoder::EncodeFrom(const SampleSource& source,
                                                                const EncodeOptions& options) const {
  MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
  MESORIG_ASSIGN_OR_RETURN(const SeparateWeights weights, WeightsOfDirections(source, options));
  return Factorise(source, Product(weights), options);
}

StatusOr<std::unique_ptr<EncodedBtf>> LinearEncoder::Close(
    const SampleSource& source, const SampleWeights& weights, const EncodeOptions& options,
    int version, const std::vector<std::pair<std::string, int>>& counts,
    LinearFactors factors) const {
  RoundFactors(source.header(), factors);
  btf::BtfFileInfo info = InfoOf(source, name(), version);
  info.codec_options_json = OptionsJson(options, factors.quantisation, weights.floor, counts);
  return LinearBtf::Create(std::move(info), std::move(factors));
}

}  // namespace mesorig::codecs
