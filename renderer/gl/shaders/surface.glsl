// What both materials share: the fragment's frame, the lights, the outputs.

const int kMaxLights = 4;

in Surface {
  vec3 p;
  vec3 normal;
  vec3 tangent;
  vec2 uv;
} surface;

layout(location = 3) uniform vec3 eye;                         // world, mm
layout(location = 4) uniform float exposure;
layout(location = 5) uniform int light_count;
layout(location = 6) uniform vec3 light_direction[kMaxLights];  // world, unit
layout(location = 10) uniform vec3 irradiance[kMaxLights];
layout(location = 14) uniform float object_number;              // from 1
layout(location = 15) uniform float finest_level;               // 0, or -1000 to read level 0 only

layout(location = 0) out vec4 out_radiance;  // exposure * radiance; alpha 1
#ifdef MESORIG_PROBE
layout(location = 1) out vec4 out_uv_object;
layout(location = 2) out vec4 out_view;
layout(location = 3) out vec4 out_normal;
layout(location = 4) out vec4 out_tangent;
#endif

// Rows are the sample frame's axes in the world: sample_from_world * direction.
mat3 SampleFromWorld() {
  vec3 n = normalize(surface.normal);
  vec3 t = normalize(surface.tangent - dot(surface.tangent, n) * n);
  return transpose(mat3(t, cross(n, t), n));
}

void Finish(vec3 radiance, mat3 sample_from_world, vec3 view) {
  out_radiance = vec4(exposure * radiance, 1.0);
#ifdef MESORIG_PROBE
  mat3 world_from_sample = transpose(sample_from_world);
  out_uv_object = vec4(surface.uv, object_number, 0.0);
  out_view = vec4(view, 0.0);
  out_normal = vec4(world_from_sample[2], 0.0);
  out_tangent = vec4(world_from_sample[0], 0.0);
#endif
}
