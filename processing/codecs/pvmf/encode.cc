#include <algorithm>

#include "processing/codecs/linear/linear_encoder.h"

namespace mesorig::codecs::pvmf {
namespace {

constexpr int kVersion = 1, kDefaultTerms = 8;

class PvmfEncoder final : public LinearEncoder {
 public:
  std::string_view name() const override { return "pvmf"; }
  unsigned options() const override { return kWeighting | kLogWeighting | kQuantisation; }
  int max_terms(const btf::SampledBtf& btf) const override { return Most(MemorySource(btf)); }

 protected:
  // Müller et al. 2004, Eq. 12.
  StatusOr<std::unique_ptr<EncodedBtf>> Factorise(const SampleSource& source,
                                                  const SampleWeights& weights,
                                                  const EncodeOptions& options) const override {
    const btf::BtfHeader& h = source.header();
    LinearShape shape;
    shape.per_view = true;
    MESORIG_ASSIGN_OR_RETURN(shape.terms, TermsOf(options, kDefaultTerms, Most(source)));
    LinearFactors factors = FactorsFor(h, shape, weights, options);
    for (int v = 0; v < h.view_count(); ++v) {
      const AbrdfMatrix matrix(source, weights, options.weighting, v);
      if (matrix.cols() == 0) continue;  // a view without any light keeps zeros
      MESORIG_ASSIGN_OR_RETURN(
          const algebra::TruncatedSvd svd,
          algebra::DecomposeTruncated(matrix, SvdOptionsFor(options, shape.terms)));
      PutTerms(matrix, svd, {}, v, v, h, factors);
    }
    return Close(source, weights, options, kVersion, {{"terms", shape.terms}}, std::move(factors));
  }

 private:
  static int Most(const SampleSource& source) {
    return std::min(MostLinearTerms(source), 3 * source.header().light_count());
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const PvmfEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::pvmf
