#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/pack_factors.h"

namespace mesorig::codecs::fmf {
namespace {

constexpr int kVersion = 1, kDefaultTerms = 16, kMaxTerms = 4096;

class FmfEncoder final : public Encoder {
 public:
  std::string_view name() const override { return "fmf"; }
  unsigned options() const override { return kWeighting | kLogWeighting | kQuantisation; }
  int max_terms(const btf::SampledBtf& btf) const override {
    return static_cast<int>(std::min<size_t>(
        {kMaxTerms, btf.header().texel_count(), 3 * btf.present_count()}));
  }

  // Müller et al. 2004, Eq. 11.
  StatusOr<std::unique_ptr<EncodedBtf>> Encode(const btf::SampledBtf& btf,
                                               const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(btf, options, *this));
    LinearShape shape;
    MESORIG_ASSIGN_OR_RETURN(shape.terms, TermsOf(options, kDefaultTerms, max_terms(btf)));
    const SampleWeights weights = WeightsFor(btf, options);
    const AbrdfMatrix matrix(btf, weights, options.weighting);
    algebra::SvdOptions svd_options;
    svd_options.rank = shape.terms;
    svd_options.block_bytes = options.block_bytes;
    MESORIG_ASSIGN_OR_RETURN(const algebra::TruncatedSvd svd,
                             algebra::DecomposeTruncated(matrix, svd_options));
    LinearFactors factors = EmptyFactors(btf.header(), shape);
    factors.quantisation = QuantisationOf(options);
    if (options.weighting == Weighting::kLog) factors.log_floor = static_cast<float>(weights.floor);
    PutTerms(matrix, svd, {}, 0, 0, btf.header(), factors);
    RoundFactors(btf.header(), factors);
    btf::BtfFileInfo info = InfoOf(btf, name(), kVersion);
    info.codec_options_json = OptionsJson(options, factors.quantisation, weights.floor,
                                          {{"terms", shape.terms}});
    return LinearBtf::Create(std::move(info), std::move(factors));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const FmfEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::fmf
