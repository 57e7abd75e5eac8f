#pragma once
// Internal to the linear bases: mip levels of weights that must not be averaged.

#include "processing/codecs/linear/linear_btf.h"

namespace mesorig::codecs {

// The levels above the first of one family, one after the other, row by row: level m has
// max(1, W >> m) x max(1, H >> m) texels (all together fewer than W * H, for W * H > 1), each of them
// what decodes nearest to the mean of the (up to four) texels below it: least squares in the basis of
// the cluster, of theirs, that fits best.
struct MipFactors {
  std::vector<float> g;        // [texel][stride]
  std::vector<float> cluster;  // [texel], zeros without clusters
};
MipFactors FitMips(const btf::BtfFileInfo& info, const LinearFactors& factors, int family);

}  // namespace mesorig::codecs
