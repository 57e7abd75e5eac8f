// Decoder of codecs fmf and pvmf (see codecs/shader_form.h for what stands before it). Layers: the
// weights g of three terms each, family * btf_columns + stack. Table: lights, 1 for a basis a view;
// then h[(view * lights + light) * 3 + channel], three terms a stack.
// Mueller et al. 2004, Eqs. 11 and 12: sum over terms of g_j(x) h_j(v, l).

vec3 DecodeBtf(vec2 uv, float level, ivec3 v, ivec3 l, mat3 pairs) {
  int lights = int(texelFetch(btf_table, 0).r);
  bool per_view = texelFetch(btf_table, 1).r != 0.0;
  vec3 rgb = vec3(0.0);
  for (int s = 0; s < btf_columns; ++s) {
    vec3 g = vec3(0.0);
    for (int i = 0; i < 3; ++i) {
      if (pairs[0][i] == 0.0 && pairs[1][i] == 0.0 && pairs[2][i] == 0.0) continue;
      if (per_view || g == vec3(0.0)) {
        float layer = float((per_view ? v[i] * btf_columns : 0) + s);
        g = textureLod(btf_layers, vec3(uv, layer), level).rgb;
      }
      for (int j = 0; j < 3; ++j) {
        if (pairs[j][i] == 0.0) continue;
        for (int c = 0; c < 3; ++c) {
          int at = 2 + (((v[i] * lights + l[j]) * 3 + c) * btf_columns + s) * 3;
          vec3 h = vec3(texelFetch(btf_table, at).r, texelFetch(btf_table, at + 1).r,
                        texelFetch(btf_table, at + 2).r);
          rgb[c] += pairs[j][i] * dot(g, h);
        }
      }
    }
  }
  return rgb * btf_scale;
}
