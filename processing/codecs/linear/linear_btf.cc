#include "processing/codecs/linear/linear_btf.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/check.h"

namespace mesorig::codecs {
namespace {

// sum_j g_j h_j for three channels; four partial sums each, so that it vectorises.
std::array<float, 3> Dot3(const float* g, const float* h, size_t stride) {
  float sums[3][4] = {};
  for (size_t k = 0; k < stride; k += 4) {
    for (size_t c = 0; c < 3; ++c) {
      for (size_t i = 0; i < 4; ++i) sums[c][i] += g[k + i] * h[c * stride + k + i];
    }
  }
  std::array<float, 3> rgb;
  for (size_t c = 0; c < 3; ++c) rgb[c] = (sums[c][0] + sums[c][1]) + (sums[c][2] + sums[c][3]);
  return rgb;
}

// Beyond any value that was measured, and still finite: files may hold anything.
constexpr float kLargestLog = 70;

constexpr float kRed = 0.299f, kGreen = 0.587f, kBlue = 0.114f;
constexpr float kLargestRatio = 1e6f, kLargestLuma = 1e30f;

}  // namespace

std::array<float, 3> ToDecorrelated(const float* rgb, float floor) {
  const float y = kRed * rgb[0] + kGreen * rgb[1] + kBlue * rgb[2];
  const float above = std::max(y, 0.0f) + floor;
  return {std::log(above / floor), (rgb[2] - y) / above, (rgb[0] - y) / above};
}

std::array<float, 3> FromDecorrelated(const std::array<float, 3>& luv, float floor) {
  const float above = std::min(floor * std::exp(std::min(luv[0], kLargestLog)), kLargestLuma);
  const float y = above - floor;
  const float u = std::clamp(luv[1], -kLargestRatio, kLargestRatio) * above;
  const float v = std::clamp(luv[2], -kLargestRatio, kLargestRatio) * above;
  return {y + v, y - (kRed * v + kBlue * u) / kGreen, y + u};
}

StatusOr<std::unique_ptr<EncodedBtf>> LinearBtf::Create(btf::BtfFileInfo info,
                                                        LinearFactors factors) {
  const LinearShape& shape = factors.shape;
  const btf::BtfHeader& header = info.header;
  const auto stride = static_cast<size_t>(shape.stride());
  const auto bases = static_cast<size_t>(shape.bases(header));
  MESORIG_CHECK(factors.g.size() ==
                static_cast<size_t>(shape.families(header)) * header.texel_count() * stride);
  MESORIG_CHECK(factors.h.size() == bases * shape.pairs(header) * 3 * stride);
  MESORIG_CHECK(factors.scales.size() == bases * stride);
  MESORIG_ASSIGN_OR_RETURN(btf::PairInterpolator interpolator,
                           btf::PairInterpolator::Build(header, info.present));
  return std::unique_ptr<EncodedBtf>(
      new LinearBtf(std::move(info), std::move(factors), std::move(interpolator)));
}

std::array<float, 3> LinearBtf::Value(int view, int light, size_t texel) const {
  std::array<float, 3> rgb = Dot3(Weights(view, texel), Vectors(view, light, texel),
                                  static_cast<size_t>(factors_.shape.stride()));
  if (factors_.decorrelated) return FromDecorrelated(rgb, factors_.log_floor);
  if (factors_.log_floor > 0) {
    for (float& x : rgb) x = std::exp(std::min(x, kLargestLog)) - factors_.log_floor;
  }
  return rgb;
}

void LinearBtf::DecodeImage(int view, int light, std::span<float> rgb) const {
  for (size_t i = 0; i < info_.header.texel_count(); ++i) {
    const auto value = Value(view, light, i);
    std::copy(value.begin(), value.end(), rgb.begin() + static_cast<std::ptrdiff_t>(3 * i));
  }
}

std::array<float, 3> LinearBtf::Evaluate(int x, int y, Vec3 v, Vec3 l) const {
  const btf::PairWeights pairs = interpolator_.Lookup(v, l);
  const size_t texel = static_cast<size_t>(y) * static_cast<size_t>(info_.header.width) +
                       static_cast<size_t>(x);
  std::array<float, 3> rgb{};
  for (size_t n = 0; n < static_cast<size_t>(pairs.count); ++n) {
    const auto value = Value(pairs.view[n], pairs.light[n], texel);
    const float weight = pairs.scale * pairs.weight[n];
    for (size_t c = 0; c < 3; ++c) rgb[c] += weight * value[c];
  }
  return rgb;
}

void LinearBtf::DecodeSamples(std::span<const NodeQuery> queries,
                              std::span<std::array<float, 3>> out) const {
  const auto width = static_cast<size_t>(info_.header.width);
  for (size_t i = 0; i < queries.size(); ++i) {
    const auto& [x, y, view, light] = queries[i];
    out[i] = Value(view, light, static_cast<size_t>(y) * width + static_cast<size_t>(x));
  }
}

}  // namespace mesorig::codecs
