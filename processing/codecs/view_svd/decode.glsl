// Decoder of codec view-svd (see shader_form.h for what stands before it and view_svd.cc for the
// three constants). Layers: light * terms + term. Table: E[view * terms + term], then, unless every
// pair is present, presence[view * lights + light].
// Wang et al. 2005, Sec. 5: sum over terms of W_i(v) E_i(x, y, l).

// pairs[j][i]: weight of (v[i], l[j]); absent pairs are never mixed in.
mat3 ViewSvdPairs(ivec3 v, vec3 v_weight, ivec3 l, vec3 l_weight) {
  mat3 pairs = outerProduct(v_weight, l_weight);
  if (kViewSvdAllPresent) return pairs;
  int presence = kViewSvdViews * btf_columns;
  mat3 kept = pairs;
  float sum = 0.0;
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) {
      kept[j][i] *= texelFetch(btf_table, presence + v[i] * kViewSvdLights + l[j]).r;
      sum += kept[j][i];
    }
  }
  // Nothing around is present: what the factors say of it is better than black.
  return sum > 1e-4 ? kept * (1.0 / sum) : pairs;
}

vec3 DecodeBtf(vec2 uv, float level, ivec3 v, vec3 v_weight, ivec3 l, vec3 l_weight) {
  mat3 pairs = ViewSvdPairs(v, v_weight, l, l_weight);
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
