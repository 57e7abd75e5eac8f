// Factors as a fragment shader reads them.

#include "processing/codecs/linear/linear_btf.h"
#include "processing/codecs/linear/linear_mips.h"

namespace mesorig::codecs {
namespace {

constexpr size_t kStack = 3;  // terms in a layer: its R, G, B

constexpr std::string_view kDecode =
#include "processing/codecs/linear/decode_glsl.inc"
    ;
constexpr std::string_view kDecodeFitted =
#include "processing/codecs/linear/decode_fitted_glsl.inc"
    ;
constexpr std::string_view kFilter =
#include "processing/codecs/filter_glsl.inc"
    ;

// `texels` rows of weights as layers of W*H*3 values from `first` on.
void PutLayers(std::span<const float> g, size_t stride, size_t used, size_t layer_texels,
               size_t first, std::vector<float>& rgb) {
  for (size_t i = 0; i * stride < g.size(); ++i) {
    for (size_t k = 0; k < used; ++k) {
      rgb[((first + k / kStack) * layer_texels + i) * 3 + k % kStack] = g[i * stride + k];
    }
  }
}

// H by stacks of three terms.
void AppendVectors(std::span<const float> h, size_t stride, size_t used, size_t stacks,
                   std::vector<float>& table) {
  const size_t first = table.size(), rows = h.size() / stride;
  table.resize(first + rows * stacks * kStack, 0.0f);
  for (size_t i = 0; i < rows; ++i) {
    for (size_t k = 0; k < used; ++k) table[first + i * stacks * kStack + k] = h[i * stride + k];
  }
}

}  // namespace

std::optional<ShaderForm> LinearBtf::ToShader() const {
  const btf::BtfHeader& header = info_.header;
  const LinearShape& shape = factors_.shape;
  const bool fitted = factors_.log_floor > 0 || !factors_.cluster.empty();
  const size_t stride = static_cast<size_t>(shape.stride()), texels = header.texel_count();
  const size_t used = static_cast<size_t>(shape.terms) + (shape.mean ? 1 : 0);
  const size_t stacks = (used + kStack - 1) / kStack, of_family = (fitted ? 2 : 1) * stacks;
  ShaderForm form;
  form.columns = static_cast<int>(stacks);
  form.layers = shape.families(header) * static_cast<int>(of_family);
  form.glsl = fitted ? kDecodeFitted : kDecode;
  if (fitted) form.glsl += kFilter;
  form.rgb.assign(static_cast<size_t>(form.layers) * texels * 3, 0.0f);
  form.table = {static_cast<float>(header.light_count()), factors_.decorrelated ? 2.0f
                                                            : shape.per_view ? 1.0f
                                                                             : 0.0f};
  std::vector<float> clusters(fitted ? 2 * texels : 0, 0.0f);
  std::copy(factors_.cluster.begin(), factors_.cluster.end(), clusters.begin());
  for (size_t f = 0; f < static_cast<size_t>(shape.families(header)); ++f) {
    PutLayers(std::span(factors_.g).subspan(f * texels * stride, texels * stride), stride, used,
              texels, f * of_family, form.rgb);
    if (!fitted) continue;
    const MipFactors mips = FitMips(info_, factors_, static_cast<int>(f));
    PutLayers(mips.g, stride, used, texels, f * of_family + stacks, form.rgb);
    if (!factors_.cluster.empty()) {
      std::copy(mips.cluster.begin(), mips.cluster.end(),
                clusters.begin() + static_cast<std::ptrdiff_t>(texels));
    }
  }
  if (fitted) {
    form.table.insert(form.table.end(),
                      {factors_.log_floor, factors_.cluster.empty() ? 0.0f : 1.0f,
                       static_cast<float>(header.view_count())});
    form.table.insert(form.table.end(), clusters.begin(), clusters.end());
  }
  AppendVectors(factors_.h, stride, used, stacks, form.table);
  return form;
}

}  // namespace mesorig::codecs
