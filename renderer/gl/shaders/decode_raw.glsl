// An image a layer: layer v * btf_columns + l, where btf_columns counts the lights.

vec3 DecodeBtf(vec2 uv, float level, ivec3 v, ivec3 l, mat3 pairs) {
  vec3 rgb = vec3(0.0);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      int layer = v[i] * btf_columns + l[j];
      if (pairs[j][i] > 0.0) {
        rgb += pairs[j][i] * textureLod(btf_layers, vec3(uv, float(layer)), level).rgb;
      }
    }
  }
  return btf_scale * rgb;
}
