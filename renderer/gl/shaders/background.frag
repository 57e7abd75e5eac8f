in vec2 place;
layout(location = 0) uniform vec3 top;
layout(location = 1) uniform vec3 bottom;
layout(location = 0) out vec4 out_radiance;
void main() { out_radiance = vec4(mix(bottom, top, place.y), 0.0); }
