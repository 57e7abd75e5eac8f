#include "processing/codecs/linear/linear_encoder.h"

namespace mesorig::codecs::fmf {
namespace {

constexpr int kVersion = 1, kDefaultTerms = 16;

class FmfEncoder final : public LinearEncoder {
 public:
  std::string_view name() const override { return "fmf"; }
  unsigned options() const override { return kWeighting | kLogWeighting | kQuantisation; }

 protected:
  // Müller et al. 2004, Eq. 11.
  StatusOr<std::unique_ptr<EncodedBtf>> Factorise(const SampleSource& source,
                                                  const SampleWeights& weights,
                                                  const EncodeOptions& options) const override {
    LinearShape shape;
    MESORIG_ASSIGN_OR_RETURN(shape.terms, TermsOf(options, kDefaultTerms, MostLinearTerms(source)));
    const AbrdfMatrix matrix(source, weights, options.weighting);
    MESORIG_ASSIGN_OR_RETURN(
        const algebra::TruncatedSvd svd,
        algebra::DecomposeTruncated(matrix, SvdOptionsFor(options, shape.terms)));
    LinearFactors factors = FactorsFor(source.header(), shape, weights, options);
    PutTerms(matrix, svd, {}, 0, 0, source.header(), factors);
    return Close(source, weights, options, kVersion, {{"terms", shape.terms}}, std::move(factors));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const FmfEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::fmf
