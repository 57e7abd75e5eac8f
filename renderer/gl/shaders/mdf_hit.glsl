// A fragment of an object with an MDF: drawn where the viewing ray hits the relief under it, at the
// depth of the hit.

layout(binding = 7) uniform sampler2D mdf_hit;  // gl/silhouettes.h
layout(location = 0) uniform mat4 clip_from_world;

float WindowDepth(vec3 p) {
  vec4 clip = clip_from_world * vec4(p, 1.0);
  return 0.5 * clip.z / clip.w;
}

// Sets the depth; false: this fragment is not what the ray meets.
bool MeetsRelief() {
  vec4 hit = texelFetch(mdf_hit, ivec2(gl_FragCoord.xy), 0);
  vec3 p = surface.p - hit.y * normalize(eye - surface.p);
  // A difference, so that a relief of no depth changes no bit.
  gl_FragDepth = gl_FragCoord.z + (WindowDepth(p) - WindowDepth(surface.p));
  return int(hit.x) == gl_PrimitiveID + 1;
}
