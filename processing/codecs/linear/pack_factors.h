#pragma once
// From a decomposition of an AbrdfMatrix to factors as files store them.

#include "processing/codecs/linear/abrdf_matrix.h"
#include "processing/codecs/linear/linear_btf.h"

namespace mesorig::codecs {

// Factors of that shape, all zero (scales 1, the mean's weight 1).
LinearFactors EmptyFactors(const btf::BtfHeader& header, const LinearShape& shape);

// Writes U sigma and V, freed from the weights, as the terms of one basis: H gets V, G gets U sigma
// of the rows of `matrix`. `mean` may be empty.
void PutTerms(const AbrdfMatrix& matrix, const algebra::TruncatedSvd& svd,
              std::span<const float> mean, int family, int basis, const btf::BtfHeader& header,
              LinearFactors& factors);

// Last: every term of every basis is balanced by powers of two, so that G and H lie in [-1, 1], and
// rounded to what the file stores.
void RoundFactors(const btf::BtfHeader& header, LinearFactors& factors);

// The quantisation that options ask for.
Quantisation QuantisationOf(const EncodeOptions& options);
// {"terms":...,"weighting":...,...}: what the file says of how it was made.
// `counts`: of terms and what else there is a number of.
std::string OptionsJson(const EncodeOptions& options, Quantisation quantisation, double floor,
                        const std::vector<std::pair<std::string, int>>& counts);

// The number of terms: options.terms, `standard` where it is 0, all. InvalidArgument beyond `most`.
StatusOr<int> TermsOf(const EncodeOptions& options, int standard, int most);

}  // namespace mesorig::codecs
