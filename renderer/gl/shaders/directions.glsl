// Interpolation between measured directions (btf::DirectionInterpolator::Lookup and HorizonScale),
// walking the tables of gl/direction_tables.h.

const int kMapSize = 64;
const float kMaxHorizonScale = 4.0;

layout(binding = 2) uniform samplerBuffer direction_rows;
layout(binding = 3) uniform samplerBuffer direction_map;

// Three measured directions, weights that sum to one, and the unit vector that they stand for: the
// asked direction, or the nearest one of the measured cone.
struct Interpolation {
  ivec3 index;
  vec3 weight;
  vec3 direction;
};

int MapCell(vec3 d) {
  vec2 p = d.xy / (abs(d.x) + abs(d.y) + max(d.z, 0.0) + 1e-20);
  vec2 cell = (vec2(p.x + p.y, p.x - p.y) + 1.0) * (0.5 * float(kMapSize));
  ivec2 c = clamp(ivec2(cell), ivec2(0), ivec2(kMapSize - 1));
  return c.y * kMapSize + c.x;
}

// The nearest point of a hull edge a-b: weights of its corners and the cosine to d.
vec3 NearestOnEdge(vec3 a, vec3 b, vec3 d) {
  vec3 n = cross(a, b);
  float alpha = dot(cross(d, b), n), beta = dot(cross(a, d), n);
  if (alpha >= 0.0 && beta >= 0.0 && alpha + beta > 0.0) {
    vec2 w = vec2(alpha, beta) / (alpha + beta);
    return vec3(w, dot(normalize(w.x * a + w.y * b), d));
  }
  float to_a = dot(a, d), to_b = dot(b, d);
  return to_a >= to_b ? vec3(1.0, 0.0, to_a) : vec3(0.0, 1.0, to_b);
}

// Slides along the hull from an edge while that comes nearer to d.
Interpolation NearestOnHull(int edge, vec3 d) {
  vec4 a = vec4(0.0), b = vec4(0.0);
  vec3 best = vec3(0.0, 0.0, -2.0);
  for (int step = 0; step < 64; ++step) {
    vec4 next_a = texelFetch(direction_rows, edge), next_b = texelFetch(direction_rows, edge + 1);
    vec3 point = NearestOnEdge(next_a.xyz, next_b.xyz, d);
    if (point.z <= best.z + 1e-7) break;
    best = point;
    a = next_a;
    b = next_b;
    if (best.x > 0.0 && best.y > 0.0) break;
    vec4 links = texelFetch(direction_rows, edge + 2);
    edge = int(best.y > 0.0 ? links.x : links.y);
  }
  return Interpolation(ivec3(int(a.w), int(b.w), int(a.w)), vec3(best.xy, 0.0),
                       normalize(best.x * a.xyz + best.y * b.xyz));
}

// d is a unit vector; map_first is where the map of its direction set starts.
Interpolation Interpolate(int map_first, vec3 d) {
  int at = int(texelFetch(direction_map, map_first + MapCell(d)).r);
  ivec3 corners = ivec3(0);
  vec3 w = vec3(1.0, 0.0, 0.0);
  for (int step = 0; step < 256 && at >= 0; ++step) {
    vec4 a = texelFetch(direction_rows, at), b = texelFetch(direction_rows, at + 1),
         c = texelFetch(direction_rows, at + 2);
    corners = ivec3(int(a.w), int(b.w), int(c.w));
    w = vec3(dot(d, a.xyz), dot(d, b.xyz), dot(d, c.xyz));
    float lowest = min(w.x, min(w.y, w.z));
    if (lowest >= -1e-6) break;
    vec4 beyond = texelFetch(direction_rows, at + 3);
    at = int(lowest == w.x ? beyond.x : lowest == w.y ? beyond.y : beyond.z);
  }
  w = max(w, 0.0);
  w /= w.x + w.y + w.z;
  if (at >= 0) return Interpolation(corners, w, d);
  return NearestOnHull(-1 - at, d);
}

// Beyond the measured cone of lights: the nearest direction's value scaled by the cosines, zero
// below the horizon.
float HorizonScale(vec3 nearest, vec3 l) {
  if (l.z <= 0.0) return 0.0;
  if (l.z >= kMaxHorizonScale * nearest.z) return kMaxHorizonScale;
  return l.z / nearest.z;
}
