// The measured pairs that stand for a view and a light (btf::PairInterpolator::Lookup).
// MESORIG_ALL_PRESENT: no pair is absent, and nothing of absent ones is looked up.

struct Pairs {
  ivec3 view;
  ivec3 light;
  mat3 weight;     // [j][i]: of (view[i], light[j]); sum one, absent pairs zero
  vec3 direction;  // unit vector that the lights stand for
};

#ifdef MESORIG_ALL_PRESENT
Pairs PairsAround(Interpolation v, Interpolation l) {
  return Pairs(v.index, l.index, outerProduct(v.weight, l.weight), l.direction);
}
#else
layout(binding = 5) uniform samplerBuffer light_directions;
layout(binding = 6) uniform samplerBuffer substitutes;  // [view * lights + light]: -1 where present,
                                                        // else the nearest pair that is

Pairs PairsAround(Interpolation v, Interpolation l) {
  int lights = textureSize(light_directions);
  mat3 weight = outerProduct(v.weight, l.weight);
  float sum = 0.0, strongest = 0.0, substitute = 0.0;
  vec3 direction = vec3(0.0);
  for (int j = 0; j < 3; ++j) {
    float of_light = 0.0;
    for (int i = 0; i < 3; ++i) {
      float other = texelFetch(substitutes, v.index[i] * lights + l.index[j]).r;
      if (other >= 0.0) {
        if (weight[j][i] > strongest) {
          strongest = weight[j][i];
          substitute = other;
        }
        weight[j][i] = 0.0;
      }
      of_light += weight[j][i];
    }
    direction += of_light * texelFetch(light_directions, l.index[j]).xyz;
    sum += of_light;
  }
  if (sum > 1e-6) return Pairs(v.index, l.index, weight * (1.0 / sum), normalize(direction));
  int pair = int(substitute);
  weight = mat3(0.0);
  weight[0][0] = 1.0;
  return Pairs(ivec3(pair / lights), ivec3(pair % lights), weight,
               texelFetch(light_directions, pair % lights).xyz);
}
#endif
