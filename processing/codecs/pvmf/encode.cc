#include <algorithm>

#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/pack_factors.h"

namespace mesorig::codecs::pvmf {
namespace {

constexpr int kVersion = 1, kDefaultTerms = 8, kMaxTerms = 4096;

class PvmfEncoder final : public Encoder {
 public:
  std::string_view name() const override { return "pvmf"; }
  unsigned options() const override { return kWeighting | kLogWeighting | kQuantisation; }
  int max_terms(const btf::SampledBtf& btf) const override {
    return static_cast<int>(std::min<size_t>(
        {kMaxTerms, btf.header().texel_count(), 3 * btf.header().lights.size()}));
  }

  // Müller et al. 2004, Eq. 12.
  StatusOr<std::unique_ptr<EncodedBtf>> Encode(const btf::SampledBtf& btf,
                                               const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(btf, options, *this));
    LinearShape shape;
    shape.per_view = true;
    MESORIG_ASSIGN_OR_RETURN(shape.terms, TermsOf(options, kDefaultTerms, max_terms(btf)));
    const SampleWeights weights = WeightsFor(btf, options);
    LinearFactors factors = EmptyFactors(btf.header(), shape);
    factors.quantisation = QuantisationOf(options);
    if (options.weighting == Weighting::kLog) factors.log_floor = static_cast<float>(weights.floor);
    algebra::SvdOptions svd_options;
    svd_options.rank = shape.terms;
    svd_options.block_bytes = options.block_bytes;
    for (int v = 0; v < btf.header().view_count(); ++v) {
      const AbrdfMatrix matrix(btf, weights, options.weighting, v);
      if (matrix.cols() == 0) continue;  // a view without any light keeps zeros
      MESORIG_ASSIGN_OR_RETURN(const algebra::TruncatedSvd svd,
                               algebra::DecomposeTruncated(matrix, svd_options));
      PutTerms(matrix, svd, {}, v, v, btf.header(), factors);
    }
    RoundFactors(btf.header(), factors);
    btf::BtfFileInfo info = InfoOf(btf, name(), kVersion);
    info.codec_options_json = OptionsJson(options, factors.quantisation, weights.floor,
                                          {{"terms", shape.terms}});
    return LinearBtf::Create(std::move(info), std::move(factors));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const PvmfEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::pvmf
