// The nearest back face beyond the layer peeled before: the far end p_b of the next interval.

layout(binding = 4) uniform sampler2D previous;  // .x: t of the layer before
layout(binding = 5) uniform sampler2D hit;       // .x > 0: this pixel has its hit

layout(location = 0) out vec4 out_crossing;  // t, uv, cosine
layout(location = 1) out vec4 out_toward;

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 to_eye = eye - surface.p;
  float t = length(to_eye);
  if (!IsBeyond(t, texelFetch(previous, pixel, 0).x) || texelFetch(hit, pixel, 0).x > 0.0) discard;
  // Seen from behind: the direction away from the surface is -v.
  Crossing c = CrossingAt(t, -to_eye / t);
  out_crossing = vec4(c.t, c.uv, c.cosine);
  out_toward = vec4(c.toward, 0.0);
}
