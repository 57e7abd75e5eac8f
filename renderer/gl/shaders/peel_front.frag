// The interval test (Wang et al. 2005, Sec. 4.1): d_f + d_b <= |p_f - p_b|.

layout(binding = 4) uniform sampler2D previous;  // .x: t of the layer before
layout(binding = 5) uniform sampler2D crossing;  // this layer's p_b: t, uv, cosine
layout(binding = 6) uniform sampler2D toward;

layout(location = 0) out vec4 out_hit;  // triangle + 1, distance to the relief

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 to_eye = eye - surface.p;
  float t = length(to_eye);
  vec4 far = texelFetch(crossing, pixel, 0);
  // (At grazing pixels p_f may lie a rounding behind its p_b.)
  if (!IsBeyond(t, texelFetch(previous, pixel, 0).x) || IsBeyond(t, far.x)) discard;
  Crossing front = CrossingAt(t, to_eye / t);
  // Without a back face (rasterised edges) the interval has no length: only a relief that reaches
  // the reference surface is hit.
  bool closed = far.x < kNone;
  float chord = closed ? max(far.x - t, 0.0) : 0.0;
  Crossing back = Crossing(far.x, far.yz, far.w, texelFetch(toward, pixel, 0).xyz);
  float d_front;
  if (!IsHit(front, back, closed, chord, d_front)) discard;
  out_hit = vec4(float(gl_PrimitiveID + 1), d_front, 0.0, 0.0);
}
