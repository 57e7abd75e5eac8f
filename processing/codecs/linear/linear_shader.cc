// Factors as a fragment shader reads them.

#include "processing/codecs/linear/linear_btf.h"

namespace mesorig::codecs {
namespace {

constexpr int kStack = 3;  // terms in a layer: its R, G, B

}  // namespace

// Weights may be filtered and mip-mapped where values are linear in them. They are not across
// clusters, nor under the exponential of log weighting: those are drawn from decoded images.
std::optional<ShaderForm> LinearBtf::ToShader() const {
  static constexpr std::string_view kDecode =
#include "processing/codecs/linear/decode_glsl.inc"
      ;
  const LinearShape& shape = factors_.shape;
  if (factors_.log_floor > 0 || !factors_.cluster.empty()) return std::nullopt;
  const btf::BtfHeader& header = info_.header;
  const auto stride = static_cast<size_t>(shape.stride()), texels = header.texel_count();
  const auto terms = static_cast<size_t>(shape.terms);
  const size_t stacks = (terms + kStack - 1) / kStack;
  ShaderForm form;
  form.columns = static_cast<int>(stacks);
  form.layers = shape.families(header) * form.columns;
  form.glsl = kDecode;
  form.rgb.assign(static_cast<size_t>(form.layers) * texels * 3, 0.0f);
  for (size_t i = 0; i < static_cast<size_t>(shape.families(header)) * texels; ++i) {
    for (size_t k = 0; k < terms; ++k) {
      const size_t layer = i / texels * stacks + k / kStack;
      form.rgb[(layer * texels + i % texels) * 3 + k % kStack] = factors_.g[i * stride + k];
    }
  }
  const size_t rows = header.views.size() * header.lights.size() * 3;
  form.table.assign(2 + rows * stacks * kStack, 0.0f);
  form.table[0] = static_cast<float>(header.light_count());
  form.table[1] = shape.per_view ? 1.0f : 0.0f;
  for (size_t i = 0; i < rows; ++i) {
    for (size_t k = 0; k < terms; ++k) {
      form.table[2 + i * stacks * kStack + k] = factors_.h[i * stride + k];
    }
  }
  return form;
}

}  // namespace mesorig::codecs
