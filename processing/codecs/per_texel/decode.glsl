// Decoder of svd2, hf and cmf: products must not be filtered, so texels are decoded and then mixed
// (codecs/filter.glsl), over mip levels that were fitted to the mean of what they stand for.
//
// Layers: the numbers of a texel, three a layer, btf_columns of them for level 0; as many for the other
// levels, one after the other, row by row. Table: lights, floor, stages; of each stage: terms, axis of
// P, axis of Q (0 none, 1 view, 2 light, 3 half, 4 difference), first number and nodes of P, of Q; the
// scales, stages a texel of level 0, then as many as level 0 has for the other levels; then of each
// pair the place of its half and of its difference vector on the grid. btf_scale is for layers.
// Mueller et al. 2004, Eq. 10.

const int kGrid = 8;

struct ChainTexel {
  ivec2 at;
  int layer;  // the first
  int place;  // among the scales
};

float NumberOf(ChainTexel t, int number) {
  return texelFetch(btf_layers, ivec3(t.at, t.layer + number / 3), 0)[number % 3];
}

// The nodes around a parameter: one, or four of a grid.
struct ChainTaps {
  int count;
  ivec4 node;
  vec4 weight;
};

ChainTaps TapsOf(int axis, int v, int l, vec4 grid) {
  if (axis < 3) return ChainTaps(1, ivec4(axis == 1 ? v : l), vec4(1.0));
  vec2 p = axis == 3 ? grid.xy : grid.zw;
  ivec2 low = min(ivec2(p), ivec2(kGrid - 2));
  vec2 f = p - vec2(low);
  int first = low.y * kGrid + low.x;
  return ChainTaps(4, ivec4(first, first + 1, first + kGrid, first + kGrid + 1),
                   vec4((1.0 - f.x) * (1.0 - f.y), f.x * (1.0 - f.y), (1.0 - f.x) * f.y, f.x * f.y));
}

vec3 DecodePair(ChainTexel t, int texels, int v, int l) {
  int lights = int(texelFetch(btf_table, 0).r), stages = int(texelFetch(btf_table, 2).r);
  int scales = 3 + 7 * stages, places = scales + 2 * texels * stages + (v * lights + l) * 4;
  vec4 grid = vec4(texelFetch(btf_table, places).r, texelFetch(btf_table, places + 1).r,
                   texelFetch(btf_table, places + 2).r, texelFetch(btf_table, places + 3).r);
  vec3 product = vec3(1.0);
  for (int s = 0; s < stages; ++s) {
    int of = 3 + 7 * s;
    int terms = int(texelFetch(btf_table, of).r);
    int axis_p = int(texelFetch(btf_table, of + 1).r), axis_q = int(texelFetch(btf_table, of + 2).r);
    int p_first = int(texelFetch(btf_table, of + 3).r), p_nodes = int(texelFetch(btf_table, of + 4).r);
    int q_first = int(texelFetch(btf_table, of + 5).r), q_nodes = int(texelFetch(btf_table, of + 6).r);
    float scale = btf_scale * texelFetch(btf_table, scales + t.place * stages + s).r;
    vec3 sum = vec3(0.0);
    ChainTaps at_p = TapsOf(axis_p, v, l, grid), at_q = TapsOf(axis_q, v, l, grid);
    for (int k = 0; k < terms; ++k) {
      float p = axis_p == 0 ? 1.0 : 0.0;
      for (int i = 0; i < at_p.count && axis_p != 0; ++i) {
        p += btf_scale * at_p.weight[i] * NumberOf(t, p_first + k * p_nodes + at_p.node[i]);
      }
      int layer = t.layer + q_first / 3 + k * q_nodes;
      for (int i = 0; i < at_q.count; ++i) {
        sum += p * at_q.weight[i] *
               texelFetch(btf_layers, ivec3(t.at, layer + at_q.node[i]), 0).rgb;
      }
    }
    product *= scale * sum;
  }
  return product - texelFetch(btf_table, 1).r;
}

ChainTexel TexelAt(ivec2 size, int level, ivec2 xy) {
  int place = xy.y * size.x + xy.x, layer = 0, before = 0;
  if (level > 0) {
    place = 0;
    for (int m = 1; m < level; ++m) {
      ivec2 s = max(size >> m, ivec2(1));
      place += s.x * s.y;
    }
    place += xy.y * max(size.x >> level, 1) + xy.x;
    layer = btf_columns;
    before = size.x * size.y;
  }
  return ChainTexel(ivec2(place % size.x, place / size.x), layer, before + place);
}

vec3 DecodeTexel(ivec2 size, int level, ivec2 xy, ivec3 v, ivec3 l, mat3 pairs) {
  ChainTexel t = TexelAt(size, level, xy);
  vec3 rgb = vec3(0.0);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      if (pairs[j][i] == 0.0) continue;
      rgb += pairs[j][i] * DecodePair(t, size.x * size.y, v[i], l[j]);
    }
  }
  return rgb;
}
