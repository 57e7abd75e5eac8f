#pragma once
// Tables of texels become tables of clusters: k-means of the factors across texels (Suykens, vom Berge,
// Lagae and Dutré 2003; Müller et al. 2004, Sec. 3.2.1 and 3.2.4).

#include "processing/codecs/per_texel/encode_chain.h"

namespace mesorig::codecs::per_texel {

// Each stage's tables are clustered by themselves into at most `clusters` means, so that texels that
// share one stage need not share the other; a texel keeps a scale, the best for all it had said. Bright
// texels count more, by the square of what they say.
//   fitter: its stages and pairs. `weights`: of texels and directions, as in the fit.
//   values: tables as they were fitted, without scales: [texel][Layout].
// Memory: about twice the largest stage's tables beside them. InvalidArgument unless 1 <= clusters <=
// kMaxClusters and at most the texels.
StatusOr<ChainFactors> ClusterTables(const ChainFitter& fitter, const ChainWeights& weights, int clusters,
                                     Quantisation quantisation, float floor,
                                     std::vector<float> values);

}  // namespace mesorig::codecs::per_texel
