#pragma once
// A BTF between its texels and over many of them, from decoded values: what a texture unit does
// (OpenGL 4.5, 8.14), for any codec, as nothing is assumed of its factors. Shaders filter factors
// instead, refitted per level where that is not the same (filter.glsl). Reentrant.

#include <array>
#include <functional>

#include "processing/codecs/codec.h"

namespace mesorig::codecs {

// Of a texel, 0 <= x < W, 0 <= y < H.
using TexelValue = std::function<std::array<float, 3>(int x, int y)>;

// Bilinear between texel centres, linear between mip levels. u and v: texture coordinates in
// repeats of the sample, its top left corner at (0, 0). level: log2 of the texels a side that are
// averaged; level k has max(1, size >> k) texels a side, each the mean over its area (of parts of
// texels, where the size is no power of two). Both finite, level not below 0 (our own bug
// otherwise). Costs up to 8 x 4^level texels.
std::array<double, 3> FilteredInSpace(int width, int height, const TexelValue& texel, double u,
                                      double v, double level);

// The same of a compressed BTF at any two directions, as its Evaluate has them: all six dimensions.
std::array<double, 3> EvaluateFiltered(const EncodedBtf& btf, double u, double v, double level,
                                       Vec3 view, Vec3 light);

}  // namespace mesorig::codecs
