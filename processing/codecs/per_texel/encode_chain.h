#pragma once
// What the encoders of svd2, hf and cmf share.

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/sample_source.h"
#include "processing/codecs/per_texel/chain_btf.h"
#include "processing/codecs/per_texel/chain_fit.h"

namespace mesorig::codecs::per_texel {

// The values of some texels, and where their tables go.
struct TexelBlock {
  size_t texels = 0;
  std::span<const float> y;  // [texel][present pair][rgb]
  std::span<float> values;   // [texel][Layout], zero
  int worker = 0;            // who asks: several blocks are fitted at once, each worker one

  std::span<const float> Y(size_t texel) const {
    return y.subspan(texel * (y.size() / texels), y.size() / texels);
  }
  std::span<float> Values(size_t texel) const {
    return values.subspan(texel * (values.size() / texels), values.size() / texels);
  }
};
using FitBlock = std::function<Status(const TexelBlock&)>;

// Weights that options ask for. `log_floor` as WeightsFor.
struct ChainWeights {
  std::vector<float> squares;      // of squared residuals: [present pair][rgb], 1 without
  std::vector<float> view, light;  // of residuals: the product nearest to them
  std::vector<float> texel;        // of residuals; empty: all alike

  float Texel(size_t i) const { return texel.empty() ? 1.0f : texel[i]; }
};
StatusOr<ChainWeights> ChainWeightsFor(const SampleSource& source, const EncodeOptions& options,
                                       const ChainFitter& fitter, double log_floor = 0);

struct ChainEncoding {
  int version = 1;
  std::vector<Stage> stages;
  Quantisation quantisation = Quantisation::kHalf;
  double floor = 0;  // subtracted when decoding
  // {"terms":...}, {}: what the file says beside the options.
  std::vector<std::pair<std::string, int>> counts;
};
// Reads the source in blocks of texels and packs what `fit` makes of them, on algebra::Threads()
// workers; clustered where options ask for it. Memory: about twice options.block_bytes beside the tables.
StatusOr<std::unique_ptr<EncodedBtf>> EncodeChain(const SampleSource& source,
                                                  const EncodeOptions& options,
                                                  const ChainEncoding& encoding,
                                                  const ChainWeights& weights,
                                                  const Encoder& encoder, const FitBlock& fit);

// One for each worker, as `fitter`.
std::vector<ChainFitter> FitterForEachWorker(const ChainFitter& fitter);

// The leading singular triplets of one texel's weighted matrix of views x (light, channel), freed from
// the weights, into stage 0, whose axes must be view and light: P = U, Q = sigma V. What is absent counts
// as the texel's mean. Müller et al. 2004, Eq. 8.
Status DecomposeTexel(const btf::BtfHeader& header, const ChainFitter& fitter,
                      const ChainWeights& weights, std::span<const float> y, std::span<float> values);

}  // namespace mesorig::codecs::per_texel
