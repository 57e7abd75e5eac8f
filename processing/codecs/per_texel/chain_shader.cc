// Tables as a fragment shader reads them: decode.glsl says where what stands.

#include "processing/codecs/per_texel/chain_btf.h"

namespace mesorig::codecs::per_texel {
namespace {

constexpr std::string_view kDecode =
#include "processing/codecs/per_texel/decode_glsl.inc"
    ;
constexpr std::string_view kFilter =
#include "processing/codecs/filter_glsl.inc"
    ;

constexpr size_t kMostLayerBytes = size_t{2} << 30;

// All texels' numbers, three a layer, as layers of W*H*3 values from `first` on.
void PutLayers(const std::vector<float>& values, size_t size, size_t layer_texels, size_t first,
               std::vector<float>& rgb) {
  for (size_t i = 0; i * size < values.size(); ++i) {
    for (size_t k = 0; k < size; ++k) {
      rgb[((first + k / 3) * layer_texels + i) * 3 + k % 3] = values[i * size + k];
    }
  }
}

}  // namespace

std::optional<ShaderForm> ChainBtf::ToShader() const {
  const btf::BtfHeader& h = info_.header;
  const size_t texels = h.texel_count(), stages = factors_.stages.size();
  const size_t stacks = (layout_.size + 2) / 3;
  if (!factors_.clusters.empty() && 24 * stacks * texels > kMostLayerBytes) return std::nullopt;
  ShaderForm form;
  form.columns = static_cast<int>(stacks);
  form.layers = static_cast<int>(2 * stacks);
  form.glsl = kDecode;
  form.glsl += kFilter;
  form.rgb.assign(2 * stacks * texels * 3, 0.0f);
  const ChainMips mips = FitMips(info_, factors_);
  if (factors_.clusters.empty()) {
    PutLayers(factors_.values, layout_.size, texels, 0, form.rgb);
  } else {
    PutLayers(TablesOfTexels(factors_, layout_, /*unscale=*/false), layout_.size, texels, 0, form.rgb);
  }
  PutLayers(mips.values, layout_.size, texels, stacks, form.rgb);
  form.table = {static_cast<float>(h.light_count()), factors_.floor, static_cast<float>(stages)};
  for (size_t s = 0; s < stages; ++s) {
    const Layout::Tables& t = layout_.stages[s];
    for (const size_t x : {static_cast<size_t>(factors_.stages[s].terms),
                           static_cast<size_t>(factors_.stages[s].p),
                           static_cast<size_t>(factors_.stages[s].q), t.p_first, t.p_nodes,
                           t.q_first, t.q_nodes}) {
      form.table.push_back(static_cast<float>(x));
    }
  }
  form.table.insert(form.table.end(), factors_.scales.begin(), factors_.scales.end());
  form.table.insert(form.table.end(), mips.scales.begin(), mips.scales.end());
  form.table.resize(3 + 7 * stages + 2 * texels * stages, 0.0f);
  for (const Vec3 v : h.views) {
    for (const Vec3 l : h.lights) {
      for (const auto& place : {GridPlace(HalfVector(v, l)), GridPlace(Difference(v, l))}) {
        form.table.insert(form.table.end(), place.begin(), place.end());
      }
    }
  }
  return form;
}

}  // namespace mesorig::codecs::per_texel
