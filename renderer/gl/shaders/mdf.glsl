// Where a viewing ray meets the mesostructure under one side of an interval (gl/silhouettes.h).

in Surface {
  vec3 p;
  vec3 normal;
  vec3 tangent;
  vec2 uv;
} surface;
in Stretch {
  vec3 along_x;  // world, mm of the surface a mm of the texture
  vec3 along_y;
} stretch;

layout(location = 3) uniform vec3 eye;                 // world, mm
layout(location = 16) uniform vec2 sample_mm_per_mm;   // mm of the sample a mm of the texture
layout(location = 17) uniform float step_mm;           // of the sample
layout(location = 18) uniform int bend_steps;          // 0: straight rays
layout(location = 19) uniform float largest_distance;  // of the MDF, mm of the sample

layout(binding = 0) uniform sampler2DArray mdf_layers;  // D v.z of every measured view, mm

const float kNone = 1e30;        // no crossing
const float kHere = 1e-4;        // crossings nearer than this part of their distance are one
const float kFlat = 0.04;        // part of a chord along which rays are straight
const float kFlattest = 1e-3;    // cosine below which the interpolated normals say nothing

bool IsBeyond(float t, float layer) { return t > layer + kHere * abs(layer); }

// One end of an interval, as seen along a direction that points away from the surface.
struct Crossing {
  float t;       // from the eye, mm
  vec2 uv;
  float cosine;  // of the direction and the normal
  vec3 toward;   // v_t = J^-1 v; zero where there is no map
};

Crossing CrossingAt(float t, vec3 v) {
  vec3 n = normalize(surface.normal);
  if (!(dot(n, n) > 0.5)) return Crossing(t, surface.uv, kFlattest, vec3(0.0));
  float cosine = dot(v, n);
  vec3 x = (stretch.along_x - dot(stretch.along_x, n) * n) / sample_mm_per_mm.x;
  vec3 y = (stretch.along_y - dot(stretch.along_y, n) * n) / sample_mm_per_mm.y;
  float area = dot(cross(x, y), n);
  vec3 toward = vec3(0.0);
  // (Also false for NaN.)
  if (area > 1e-5 * length(x) * length(y)) {
    toward = vec3(dot(cross(v, y), n) / area, dot(cross(x, v), n) / area, cosine / sqrt(area));
  }
  return Crossing(t, surface.uv, max(cosine, kFlattest), toward);
}

// Depth below the reference plane at uv, between three views and four texels, on the one layer that
// most of their weight lies on.
float DepthBetween(vec2 uv, Interpolation views) {
  ivec2 size = textureSize(mdf_layers, 0).xy;
  vec2 at = uv * vec2(size) - 0.5;
  vec2 corner = floor(at), part = at - corner;
  // (% of negative numbers is undefined.)
  ivec2 low = clamp(ivec2(corner - floor(corner / vec2(size)) * vec2(size)), ivec2(0), size - 1);
  ivec2 high = (low + 1) % size;
  vec4 of_texel = vec4((1.0 - part.x) * (1.0 - part.y), part.x * (1.0 - part.y),
                       (1.0 - part.x) * part.y, part.x * part.y);
  vec4 depth[3];
  float heaviest = 0.0, layer = 0.0;
  for (int i = 0; i < 3; ++i) {
    int view = views.index[i];
    depth[i] = vec4(texelFetch(mdf_layers, ivec3(low, view), 0).r,
                    texelFetch(mdf_layers, ivec3(high.x, low.y, view), 0).r,
                    texelFetch(mdf_layers, ivec3(low.x, high.y, view), 0).r,
                    texelFetch(mdf_layers, ivec3(high, view), 0).r);
  }
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 4; ++k) {
      float mass = 0.0;
      for (int j = 0; j < 3; ++j) {
        mass += dot(views.weight[j] * of_texel,
                    vec4(lessThanEqual(abs(depth[j] - depth[i][k]), vec4(step_mm))));
      }
      // (The same layer from another of its samples is no better by a rounding.)
      if (views.weight[i] * of_texel[k] > 0.0 && mass > heaviest + 1e-4) {
        heaviest = mass;
        layer = depth[i][k];
      }
    }
  }
  float sum = 0.0, weights = 0.0;
  for (int i = 0; i < 3; ++i) {
    vec4 same = views.weight[i] * of_texel *
                vec4(lessThanEqual(abs(depth[i] - layer), vec4(step_mm)));
    sum += dot(same, depth[i] - layer);
    weights += dot(same, vec4(1.0));
  }
  return layer + sum / weights;  // (the layer's own sample has weight: weights > 0)
}

// D(toward/|toward|)/|toward|, mm on the surface.
float DistanceAlong(vec2 uv, vec3 toward) {
  float stretched = length(toward);
  if (!(stretched > 0.0)) return 0.0;
  Interpolation views = Interpolate(0, toward / stretched);
  return DepthBetween(uv, views) / (views.direction.z * stretched);
}

// No DistanceAlong is more, however the ray bends (its component along the surface stays).
float LargestDistance(vec3 toward) {
  float along = length(toward.xy);
  return along > 0.0 ? largest_distance / along : kNone;
}

// d_f + d_b <= chord. One loop for both ends, front first: a rasteriser in software runs through
// every branch, but leaves a loop.
bool IsHit(Crossing front, Crossing back, bool closed, float chord, out float d_front) {
  Crossing end = front;
  float other_cosine = back.cosine, slope = 1.0, t = 0.0;
  int bends = 0;
  bool at_back = false;
  d_front = 0.0;
  for (int i = 0; i < 2 * (bend_steps + 1); ++i) {
    float next = DistanceAlong(end.uv, vec3(end.toward.xy, end.toward.z * slope));
    // Far from the other end the surface under the ray is as good as flat.
    bool settled = bends == 0 ? !(next > kFlat * chord) : abs(next - t) <= 2e-3 * t;
    t = next;
    if (!settled && bends < bend_steps && chord > 0.0) {
      float s = min(t / chord, 0.5);
      slope = (1.0 - s) * ((1.0 - s) + s * other_cosine / end.cosine);
      ++bends;
      continue;
    }
    if (at_back) return d_front + t <= chord;
    d_front = t;
    if (!(d_front <= chord)) return false;
    // Most pixels lie far within the silhouette: it is enough that d_b cannot be too large.
    if (!closed || d_front + LargestDistance(back.toward) <= chord) return true;
    at_back = true;
    end = back;
    other_cosine = front.cosine;
    slope = 1.0;
    bends = 0;
  }
  return false;
}
