#pragma once
// How much each sample of a BTF counts in a factorisation: a weight a texel times a weight a
// (pair, channel), so that a weighted fit is a plain decomposition of the scaled matrix.

#include <vector>

#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/sample_source.h"

namespace mesorig::codecs {

// The share of the sphere's cap around +z, down to the lowest direction, that lies nearest to each
// direction; their mean is 1. Directions that nearly coincide share what one of them would have.
std::vector<double> SolidAngleWeights(const std::vector<Vec3>& directions);

// How far samples can be trusted, from the variance s(x, v, l) that the BTF holds:
//
//   weight of a squared residual  W = 1 / (s + f),  f = options.floor^2, else a hundredth of the mean s
//
// (without f a sample that happens to have no variance would be all that counts). A factorisation takes
// a weight a texel times a weight a pair: the product nearest to W in the logarithm, which is W itself
// where noise depends on the texel alone, on the directions alone, or is a product of both. `log_floor`
// above 0: what is fitted is log(value + log_floor), whose variance is s / (value + log_floor)^2.
// Both have a geometric mean of 1 over what is present inside the mask; all 1 where s is 0 everywhere.
struct VarianceWeights {
  std::vector<double> texel, pair;  // of squared residuals; pair = v * nL + l
};
StatusOr<VarianceWeights> WeightsOfVariance(const SampleSource& source, const EncodeOptions& options,
                                            double log_floor);

struct SampleWeights {
  std::vector<float> texel;    // W*H; positive
  std::vector<float> sample;   // pair * 3 + channel, pair = v * nL + l; positive
  double floor = 0;            // of log and relative; 0 for linear
};
// What options.weighting, options.solid_angle and options.variance ask for: of residuals, not of their
// squares. Reads the source up to three times, not at all where nothing depends on its values. Texels outside the mask get kOutsideMask times their weight.
// `log_floor`: of codecs that fit a logarithm whatever the weighting.
inline constexpr float kOutsideMask = 1e-3f;
StatusOr<SampleWeights> WeightsFor(const SampleSource& source, const EncodeOptions& options,
                                   double log_floor = 0);
// Whether options ask for weights of pairs at all.
bool WeighsPairs(const EncodeOptions& options);

// The floor of codecs that know nothing but the logarithm (hf, dfmf): options.floor, else a quarter of
// the RMS; shadows whose logarithm falls without end would take all the factors' freedom (the demo's
// sample: an error of 0.54 for hf and 0.49 for 8 terms of dfmf with a hundredth, 0.40 and 0.36 with a
// quarter). 1 for what is black: its logarithm 0 is stored exactly.
StatusOr<double> WideFloor(const SampleSource& source, const EncodeOptions& options);

// A weight a texel times one a view times one a light: what a decomposition can take that has views or
// lights for rows or columns of their own.
struct SeparateWeights {
  std::vector<float> view, light, texel;
  double floor = 0;
  bool plain = true;  // all are 1
};
// The product that comes nearest to WeightsFor: exact for solid angles.
StatusOr<SeparateWeights> SeparateWeightsFor(const SampleSource& source,
                                             const EncodeOptions& options);
// The product that comes nearest to `samples`; its texels' weights are those.
SeparateWeights NearestProduct(SampleWeights samples, size_t views, size_t lights);
// A product of weights, as weights of samples.
SampleWeights Product(const SeparateWeights& weights);

}  // namespace mesorig::codecs
