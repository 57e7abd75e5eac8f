#pragma once
// How much each sample of a BTF counts in a factorisation: a weight a texel times a weight a
// (pair, channel), so that a weighted fit is a plain decomposition of the scaled matrix.

#include <vector>

#include "processing/codecs/encoder.h"

namespace mesorig::codecs {

// The share of the sphere's cap around +z, down to the lowest direction, that lies nearest to each
// direction; their mean is 1. Directions that nearly coincide share what one of them would have.
std::vector<double> SolidAngleWeights(const std::vector<Vec3>& directions);

struct SampleWeights {
  std::vector<float> texel;    // W*H; positive
  std::vector<float> sample;   // pair * 3 + channel, pair = v * nL + l; positive
  double floor = 0;            // of log and relative; 0 for linear
};
// What options.weighting and options.solid_angle ask for. Reads the BTF once or twice. Texels outside
// the mask get kOutsideMask times their weight.
inline constexpr float kOutsideMask = 1e-3f;
SampleWeights WeightsFor(const btf::SampledBtf& btf, const EncodeOptions& options);

// The floor of codecs that know nothing but the logarithm (hf, dfmf): options.floor, else a quarter of
// the RMS; shadows whose logarithm falls without end would take all the factors' freedom (the demo's
// sample: an error of 0.54 for hf and 0.49 for 8 terms of dfmf with a hundredth, 0.40 and 0.36 with a
// quarter). 1 for what is black: its logarithm 0 is stored exactly.
double WideFloor(const btf::SampledBtf& btf, const EncodeOptions& options);

// A weight a texel times one a view times one a light: what a decomposition can take that has views or
// lights for rows or columns of their own.
struct SeparateWeights {
  std::vector<float> view, light, texel;
  double floor = 0;
  bool plain = true;  // all are 1
};
// The product that comes nearest to WeightsFor: exact for solid angles.
SeparateWeights SeparateWeightsFor(const btf::SampledBtf& btf, const EncodeOptions& options);

}  // namespace mesorig::codecs
