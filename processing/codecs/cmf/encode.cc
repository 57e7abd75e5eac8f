#include <algorithm>

#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/pack_factors.h"
#include "processing/codecs/per_texel/encode_chain.h"

namespace mesorig::codecs::cmf {
namespace {

using per_texel::Axis;

constexpr int kDefaultTerms = 1, kMostTerms = 4;
constexpr int kSweepsOfSecond = 3;

// Sweeps of both stages together. More of them lower the error, but widen the range that bytes have to
// hold, and let texels share out their product differently, so that tables of clusters fit worse.
int SweepsOfBoth(const EncodeOptions& options, Quantisation quantisation) {
  if (options.clusters > 0) return 0;
  return quantisation == Quantisation::kByte ? 2 : 10;
}

class CmfEncoder final : public Encoder {
 public:
  std::string_view name() const override { return "cmf"; }
  unsigned options() const override { return kClusters | kWeighting | kQuantisation; }
  int max_terms(const btf::SampledBtf& btf) const override { return Most(btf.header()); }

  // Müller et al. 2004, Eq. 10.
  StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                   const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
    const btf::BtfHeader& h = source.header();
    MESORIG_ASSIGN_OR_RETURN(const int terms, TermsOf(options, kDefaultTerms, Most(h)));
    per_texel::ChainEncoding encoding;
    encoding.version = options.clusters > 0 ? 2 : 1;
    encoding.stages = {{Axis::kView, Axis::kLight, terms}, {Axis::kHalf, Axis::kDifference, 1}};
    encoding.quantisation = QuantisationOf(options);
    encoding.counts = {{"terms", terms}};
    const per_texel::ChainFitter fitter(h, source.present(), encoding.stages);
    MESORIG_ASSIGN_OR_RETURN(const per_texel::ChainWeights weights,
                             per_texel::ChainWeightsFor(source, options, fitter));
    const int of_both = SweepsOfBoth(options, encoding.quantisation);
    const size_t second = fitter.layout().stages[1].p_first;
    auto fitters = per_texel::FitterForEachWorker(fitter);
    return per_texel::EncodeChain(
        source, options, encoding, weights, *this, [&](const per_texel::TexelBlock& block) -> Status {
          per_texel::ChainFitter& own = fitters[static_cast<size_t>(block.worker)];
          for (size_t i = 0; i < block.texels; ++i) {
            const auto values = block.Values(i);
            MESORIG_RETURN_IF_ERROR(per_texel::DecomposeTexel(h, fitter, weights, block.Y(i), values));
            std::fill(values.begin() + static_cast<std::ptrdiff_t>(second), values.end(), 1.0f);
          }
          own.Refine(block.y, weights.squares, kSweepsOfSecond, 1, block.values);
          own.Refine(block.y, weights.squares, of_both, 0, block.values);
          return OkStatus();
        });
  }

 private:
  static int Most(const btf::BtfHeader& h) {
    return std::min({h.view_count(), 3 * h.light_count(), kMostTerms});
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const CmfEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::cmf
