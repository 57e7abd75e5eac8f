// An image a layer: layer v * btf_columns + l, where btf_columns counts the lights. btf_table is 1
// where that pair is present; pairs that are absent are left out and the others carry their weight.

vec3 DecodeBtf(vec2 uv, float level, ivec3 v, vec3 v_weight, ivec3 l, vec3 l_weight) {
  vec4 sum = vec4(0.0);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      int layer = v[i] * btf_columns + l[j];
      float weight = v_weight[i] * l_weight[j] * texelFetch(btf_table, layer).r;
      if (weight > 0.0) {
        sum += weight * vec4(textureLod(btf_layers, vec3(uv, float(layer)), level).rgb, 1.0);
      }
    }
  }
  return sum.a > 0.0 ? sum.rgb * (btf_scale / sum.a) : vec3(0.0);
}
