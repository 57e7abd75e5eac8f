// Decoder of codec view-svd (see shader_form.h for what stands before it). Layers: light * terms +
// term. Table: E[view * terms + term]. btf_columns: terms.
// Wang et al. 2005, Sec. 5: sum over terms of W_i(v) E_i(x, y, l).

vec3 DecodeBtf(vec2 uv, float level, ivec3 v, ivec3 l, mat3 pairs) {
  vec3 rgb = vec3(0.0);
  for (int k = 0; k < btf_columns; ++k) {
    vec3 e = vec3(texelFetch(btf_table, v.x * btf_columns + k).r,
                  texelFetch(btf_table, v.y * btf_columns + k).r,
                  texelFetch(btf_table, v.z * btf_columns + k).r);
    for (int j = 0; j < 3; ++j) {
      float weight = dot(e, pairs[j]);
      if (weight != 0.0) {
        rgb += weight * textureLod(btf_layers, vec3(uv, float(l[j] * btf_columns + k)), level).rgb;
      }
    }
  }
  return rgb * btf_scale;
}
