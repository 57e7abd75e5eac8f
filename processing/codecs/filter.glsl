// Behind decoders whose factors must not be filtered: texels are decoded, and their values filtered as
// the sampler would filter texels. Such a decoder defines
//   vec3 DecodeTexel(ivec2 size, int level, ivec2 xy, ivec3 v, ivec3 l, mat3 pairs)
// texel xy of a mip level, `size` being that of level 0, and v, l, pairs those of DecodeBtf.

// Bilinear, repeating.
vec3 DecodeLevel(vec2 uv, int level, ivec3 v, ivec3 l, mat3 pairs) {
  ivec2 full = textureSize(btf_layers, 0).xy;
  ivec2 size = max(full >> level, ivec2(1));
  vec2 p = fract(uv) * vec2(size) - 0.5;
  ivec2 low = ivec2(floor(p));
  vec2 f = p - vec2(low);
  vec3 rgb = vec3(0.0);
  for (int k = 0; k < 4; ++k) {
    ivec2 corner = ivec2(k & 1, k >> 1);
    float weight = (corner.x == 1 ? f.x : 1.0 - f.x) * (corner.y == 1 ? f.y : 1.0 - f.y);
    if (weight == 0.0) continue;
    rgb += weight * DecodeTexel(full, level, (low + corner + size) % size, v, l, pairs);
  }
  return rgb;
}

// Between two levels.
vec3 DecodeBtf(vec2 uv, float level, ivec3 v, ivec3 l, mat3 pairs) {
  ivec2 size = textureSize(btf_layers, 0).xy;
  float last = floor(log2(float(max(size.x, size.y))) + 0.001);
  float at = clamp(level, 0.0, last), below = floor(at);
  vec3 rgb = DecodeLevel(uv, int(below), v, l, pairs);
  if (at == below) return rgb;
  return mix(rgb, DecodeLevel(uv, int(below) + 1, v, l, pairs), at - below);
}
