#pragma once
// What the encoders of linear bases have in common: weights, options and closing, from memory as from
// a file that is never held whole.

#include <string>
#include <utility>
#include <vector>

#include "processing/codecs/linear/pack_factors.h"
#include "processing/codecs/linear/sample_source.h"

namespace mesorig::codecs {

// min(4096, texels, columns).
int MostLinearTerms(const SampleSource& source);
algebra::SvdOptions SvdOptionsFor(const EncodeOptions& options, int64_t rank);
// Zero, with what the options say of quantisation and logarithm.
LinearFactors FactorsFor(const btf::BtfHeader& header, const LinearShape& shape,
                         const SampleWeights& weights, const EncodeOptions& options);

// An encoder whose factors come from matrices of texels x directions.
class LinearEncoder : public Encoder {
 public:
  int max_terms(const btf::SampledBtf& btf) const override;
  StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                   const EncodeOptions& options) const override;

 protected:
  virtual StatusOr<std::unique_ptr<EncodedBtf>> Factorise(const SampleSource& source,
                                                          const SampleWeights& weights,
                                                          const EncodeOptions& options) const = 0;
  // Rounds the factors and says how they were made. `counts` as in OptionsJson.
  StatusOr<std::unique_ptr<EncodedBtf>> Close(
      const SampleSource& source, const SampleWeights& weights, const EncodeOptions& options,
      int version, const std::vector<std::pair<std::string, int>>& counts,
      LinearFactors factors) const;
};

}  // namespace mesorig::codecs
