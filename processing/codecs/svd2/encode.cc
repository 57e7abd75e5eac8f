#include <algorithm>

#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/pack_factors.h"
#include "processing/codecs/linear/sample_weights.h"
#include "processing/codecs/per_texel/encode_chain.h"

namespace mesorig::codecs::svd2 {
namespace {

using per_texel::Axis;

constexpr int kDefaultTerms = 2, kSweeps = 20;

class Svd2Encoder final : public Encoder {
 public:
  std::string_view name() const override { return "svd2"; }
  unsigned options() const override { return kWeighting | kQuantisation; }
  int max_terms(const btf::SampledBtf& btf) const override { return Most(btf.header()); }

  // Müller et al. 2004, Eq. 8.
  StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                   const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
    const btf::BtfHeader& h = source.header();
    MESORIG_ASSIGN_OR_RETURN(const int terms, TermsOf(options, kDefaultTerms, Most(h)));
    per_texel::ChainEncoding encoding;
    encoding.stages = {{Axis::kView, Axis::kLight, terms}};
    encoding.quantisation = QuantisationOf(options);
    encoding.counts = {{"terms", terms}};
    const per_texel::ChainFitter fitter(h, source.present(), encoding.stages);
    MESORIG_ASSIGN_OR_RETURN(const per_texel::ChainWeights weights,
                             per_texel::ChainWeightsFor(source, options, fitter));
    const bool plain = fitter.pairs().size() == source.present().size() && !WeighsPairs(options);
    auto fitters = per_texel::FitterForEachWorker(fitter);
    return per_texel::EncodeChain(
        source, options, encoding, weights, *this, [&](const per_texel::TexelBlock& block) -> Status {
          per_texel::ChainFitter& own = fitters[static_cast<size_t>(block.worker)];
          for (size_t i = 0; i < block.texels; ++i) {
            MESORIG_RETURN_IF_ERROR(
                per_texel::DecomposeTexel(h, fitter, weights, block.Y(i), block.Values(i)));
          }
          if (!plain) own.Refine(block.y, weights.squares, kSweeps, 0, block.values);
          return OkStatus();
        });
  }

 private:
  static int Most(const btf::BtfHeader& h) {
    return std::min({h.view_count(), 3 * h.light_count(), 4096});
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const Svd2Encoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::svd2
