layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 tangent;
layout(location = 3) in vec2 texture_mm;
#ifdef MESORIG_STRETCH
layout(location = 4) in vec3 along_x;
layout(location = 5) in vec3 along_y;
out Stretch {
  vec3 along_x;  // world, mm of the surface a mm of the texture
  vec3 along_y;
} stretch;
#endif
#ifdef MESORIG_MDF
invariant gl_Position;  // the peeling's triangles are found again by number
#endif

layout(location = 0) uniform mat4 clip_from_world;
layout(location = 1) uniform mat4 world_from_object;
layout(location = 2) uniform vec2 units_per_mm;

out Surface {
  vec3 p;        // world, mm
  vec3 normal;   // world
  vec3 tangent;  // world, along the sample's +x
  vec2 uv;       // repeats of the sample from its top left corner, v downwards
} surface;

void main() {
  vec4 p = world_from_object * vec4(position, 1.0);
  surface.p = p.xyz;
  surface.normal = mat3(world_from_object) * normal;
  surface.tangent = mat3(world_from_object) * tangent;
  vec2 units = texture_mm * units_per_mm;
  surface.uv = vec2(0.5 + units.x, 0.5 - units.y);
#ifdef MESORIG_STRETCH
  stretch.along_x = mat3(world_from_object) * along_x;
  stretch.along_y = mat3(world_from_object) * along_y;
#endif
  gl_Position = clip_from_world * p;
}
