// Averages the shaded samples of a pixel in linear light, then sRGB (IEC 61966-2-1).
in vec2 place;
layout(binding = 0) uniform sampler2D radiance;
layout(location = 0) uniform int supersample;
layout(location = 0) out vec4 out_colour;
void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * supersample;
  vec3 sum = vec3(0.0);
  for (int y = 0; y < supersample; ++y) {
    for (int x = 0; x < supersample; ++x) {
      // A highlight counts as white: it must not eat the antialiasing of its edge.
      sum += clamp(texelFetch(radiance, first + ivec2(x, y), 0).rgb, 0.0, 1.0);
    }
  }
  vec3 c = sum / float(supersample * supersample);
  vec3 low = 12.92 * c, high = 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055;
  out_colour = vec4(mix(high, low, lessThanEqual(c, vec3(0.0031308))), 1.0);
}
