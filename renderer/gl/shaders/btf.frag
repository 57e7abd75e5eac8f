// The BTF at the fragment's own view and light. The value carries the cosine of the light: no n.l.

layout(location = 16) uniform int light_map_first;  // where the lights' map starts in direction_map

void main() {
  mat3 sample_from_world = SampleFromWorld();
  vec3 view = sample_from_world * normalize(eye - surface.p);
  float level = max(textureQueryLod(btf_layers, surface.uv).y + finest_level, 0.0);
  Interpolation v = Interpolate(0, view);
#ifdef MESORIG_MDF
  if (!MeetsRelief()) discard;  // (after the derivatives)
#endif
  vec3 radiance = vec3(0.0);
  for (int i = 0; i < light_count; ++i) {
    vec3 light = sample_from_world * light_direction[i];
    if (light.z <= 0.0) continue;
    Interpolation l = Interpolate(light_map_first, light);
    Pairs pairs = PairsAround(v, l);
    vec3 value = DecodeBtf(surface.uv, level, pairs.view, pairs.light, pairs.weight);
    radiance += irradiance[i] * max(value, 0.0) * HorizonScale(pairs.direction, light);
  }
  Finish(radiance, sample_from_world, view);
}
