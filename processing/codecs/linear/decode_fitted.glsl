// Decoder of the linear bases whose weights must not be filtered: those of clusters (pcmf), and all
// under the exponential of log weighting. Texels are decoded and then mixed (codecs/filter.glsl), over
// mip levels whose weights were fitted to the mean of what they stand for.
//
// Layers: family * 2 * btf_columns + stack, three terms each: the weights of level 0; from
// btf_columns on those of the other levels, one after the other, row by row. Table: lights; 1 for a
// basis a view, 2 for decorrelated channels (log Y, U / Y, V / Y); the floor of log weighting or 0; 1 where there are clusters; the cluster of each texel
// of level 0, then of the other levels; then h[((cluster * views + view) * lights + light) * 3 +
// channel], three terms a stack. btf_scale is not for h: the layers alone are scaled.
// Mueller et al. 2004, Eqs. 11 to 13.

struct BtfTexel {
  int place;    // among the texels of level 0, or of the others
  bool coarse;  // not level 0
};

BtfTexel PlaceOf(ivec2 size, int level, ivec2 xy) {
  if (level == 0) return BtfTexel(xy.y * size.x + xy.x, false);
  int first = 0;
  for (int m = 1; m < level; ++m) {
    ivec2 s = max(size >> m, ivec2(1));
    first += s.x * s.y;
  }
  return BtfTexel(first + xy.y * max(size.x >> level, 1) + xy.x, true);
}

vec3 DecodeTexel(ivec2 size, int level, ivec2 xy, ivec3 v, ivec3 l, mat3 pairs) {
  BtfTexel t = PlaceOf(size, level, xy);
  int lights = int(texelFetch(btf_table, 0).r), views = int(texelFetch(btf_table, 4).r);
  int texels = size.x * size.y;
  bool per_view = texelFetch(btf_table, 1).r == 1.0, decorrelated = texelFetch(btf_table, 1).r == 2.0;
  float floor_value = texelFetch(btf_table, 2).r;
  int cluster = 0;
  if (texelFetch(btf_table, 3).r != 0.0) {
    cluster = int(texelFetch(btf_table, 5 + (t.coarse ? texels : 0) + t.place).r);
  }
  ivec2 at = ivec2(t.place % size.x, t.place / size.x);
  vec3 rgb = vec3(0.0);
  for (int i = 0; i < 3; ++i) {
    int layer = (per_view ? v[i] : 0) * 2 * btf_columns + (t.coarse ? btf_columns : 0);
    for (int j = 0; j < 3; ++j) {
      if (pairs[j][i] == 0.0) continue;
      int row = ((cluster * views + v[i]) * lights + l[j]) * 3;
      vec3 value = vec3(0.0);
      for (int s = 0; s < btf_columns; ++s) {
        vec3 g = texelFetch(btf_layers, ivec3(at, layer + s), 0).rgb * btf_scale;
        for (int c = 0; c < 3; ++c) {
          int h = 5 + 2 * texels + ((row + c) * btf_columns + s) * 3;
          value[c] += dot(g, vec3(texelFetch(btf_table, h).r, texelFetch(btf_table, h + 1).r,
                                  texelFetch(btf_table, h + 2).r));
        }
      }
      if (decorrelated) {
        float above = min(floor_value * exp(min(value[0], 70.0)), 1e30), y = above - floor_value;
        vec2 uv = clamp(value.yz, -1e6, 1e6) * above;
        value = vec3(y + uv.y, y - (0.299 * uv.y + 0.114 * uv.x) / 0.587, y + uv.x);
      } else if (floor_value > 0.0) value = exp(min(value, vec3(70.0))) - floor_value;
      rgb += pairs[j][i] * value;
    }
  }
  return rgb;
}
