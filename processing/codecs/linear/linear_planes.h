#pragma once
// Internal to codecs that store weights per texel: the planes that they have in common (README.md).

#include <string>
#include <vector>

#include "processing/codecs/linear/linear_btf.h"

namespace mesorig::codecs {

// "t0000", "t0001", ...: a channel a term.
std::vector<std::string> TermChannels(int terms);
// The terms that the channels of part `name` show. InvalidArgument without it, and beyond 4096.
StatusOr<int> CountTerms(const btf::CodedBtf& file, const std::string& name);

// Weights of texels: family `family` of factors.g, without a mean's.
btf::Plane WeightPlane(std::string name, const btf::BtfHeader& header, const LinearFactors& factors,
                       int family);
// Appends the part's weights to factors.g, for which shape is set, and says how they were stored.
Status TakeWeights(btf::CodedBtf& file, const std::string& name, LinearFactors& factors);

// `S`: scales, powers of two within 2^+-100; width x height.
btf::Plane ScalePlane(int width, int height, std::vector<float> scales);
StatusOr<std::vector<float>> TakeScales(btf::CodedBtf& file, int width, int height);
// `P`: the floor of log weighting, 0 for linear.
btf::Plane FloorPlane(float floor);
StatusOr<float> TakeFloor(btf::CodedBtf& file);

// InvalidArgument names a part that nothing has taken.
Status CheckNothingLeft(const btf::CodedBtf& file);

}  // namespace mesorig::codecs
