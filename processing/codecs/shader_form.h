#pragma once
// A compressed BTF as a fragment shader reads it: images in the layers of an array texture (which
// the renderer filters and mip-maps, so the decoder must be linear in them at fixed directions), a
// table of floats, and the decoder in GLSL 4.50, a codec's `decode.glsl`.
//
// The decoder defines
//   vec3 DecodeBtf(vec2 uv, float level, ivec3 v, ivec3 l, mat3 pairs)
// linear RGB, sr^-1, at three measured views and three measured lights, where pairs[j][i] is the
// weight of the pair (v[i], l[j]). Weights sum to one and are zero for pairs that are absent, as
// btf::PairInterpolator gives them. The decoder reads what the renderer declares before it:
//   uniform sampler2DArray btf_layers;  sample with textureLod(btf_layers, vec3(uv, layer), level)
//   uniform samplerBuffer btf_table;    texelFetch(btf_table, i).r
//   uniform int btf_columns;            ShaderForm::columns
//   uniform float btf_scale;            multiply what is sampled by it
// (No storage buffers: a software rasteriser reads them many times more slowly.)

#include <string>
#include <vector>

namespace mesorig::codecs {

struct ShaderForm {
  int layers = 0;
  std::vector<float> rgb;    // [layer][row][column][rgb], W*H texels a layer
  std::vector<float> table;  // of the decoder's own meaning
  int columns = 0;           // stride of the table or of the layers, of the decoder's own meaning
  std::string glsl;
};

}  // namespace mesorig::codecs
