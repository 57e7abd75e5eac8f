#include "processing/codecs/linear/linear_encoder.h"

#include <algorithm>

namespace mesorig::codecs {
namespace {

constexpr int kMaxTerms = 4096;

}  // namespace

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

StatusOr<std::unique_ptr<EncodedBtf>> LinearEncoder::EncodeFrom(const SampleSource& source,
                                                                const EncodeOptions& options) const {
  MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
  MESORIG_ASSIGN_OR_RETURN(const SampleWeights weights, WeightsFor(source, options));
  return Factorise(source, weights, options);
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
