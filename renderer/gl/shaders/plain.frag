// The Lambert fit of the most frontal view as a texture: what one has without a BTF.

layout(binding = 1) uniform sampler2D plain_texture;  // rho / pi over plain_scale
layout(location = 16) uniform float plain_scale;

void main() {
  mat3 sample_from_world = SampleFromWorld();
  vec3 view = sample_from_world * normalize(eye - surface.p);
  float level = max(textureQueryLod(plain_texture, surface.uv).y + finest_level, 0.0);
  vec3 reflectance = plain_scale * textureLod(plain_texture, surface.uv, level).rgb;
  vec3 radiance = vec3(0.0);
  for (int i = 0; i < light_count; ++i) {
    radiance += irradiance[i] * reflectance * max((sample_from_world * light_direction[i]).z, 0.0);
  }
  Finish(radiance, sample_from_world, view);
}
