// Interpolation between measured directions (btf::DirectionInterpolator::Lookup and HorizonScale),
// walking the tables of gl/direction_tables.h.

const int kMapSize = 64;
const float kMaxHorizonScale = 4.0;

layout(std430, binding = 1) readonly buffer Directions { vec4 measured[]; };
layout(std430, binding = 2) readonly buffer Triangles { ivec4 triangles[]; };
layout(std430, binding = 3) readonly buffer Hull { ivec4 hull_edges[]; };
layout(std430, binding = 4) readonly buffer DirectionMap { int start_map[]; };

// Three measured directions (places in measured[]), weights that sum to one, and the unit vector
// that they stand for: the asked direction, or the nearest one of the measured cone.
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

// The nearest point of a hull edge: weights of its two corners and the cosine to d.
vec3 NearestOnEdge(ivec4 edge, vec3 d) {
  vec3 a = measured[edge.x].xyz, b = measured[edge.y].xyz, n = cross(a, b);
  float alpha = dot(cross(d, b), n), beta = dot(cross(a, d), n);
  if (alpha >= 0.0 && beta >= 0.0 && alpha + beta > 0.0) {
    vec2 w = vec2(alpha, beta) / (alpha + beta);
    return vec3(w, dot(normalize(w.x * a + w.y * b), d));
  }
  float to_a = dot(a, d), to_b = dot(b, d);
  return to_a >= to_b ? vec3(1.0, 0.0, to_a) : vec3(0.0, 1.0, to_b);
}

Interpolation NearestOnHull(int edge, vec3 d) {
  vec3 best = NearestOnEdge(hull_edges[edge], d);
  for (int step = 0; step < 64; ++step) {  // slide along the hull while it comes nearer
    ivec4 e = hull_edges[edge];
    if (best.x > 0.0 && best.y > 0.0) break;
    int other = best.y > 0.0 ? e.z : e.w;
    vec3 point = NearestOnEdge(hull_edges[other], d);
    if (other == edge || point.z <= best.z + 1e-7) break;
    edge = other;
    best = point;
  }
  ivec4 e = hull_edges[edge];
  vec3 q = normalize(best.x * measured[e.x].xyz + best.y * measured[e.y].xyz);
  return Interpolation(ivec3(e.x, e.y, e.x), vec3(best.xy, 0.0), q);
}

// d is a unit vector; map_first is where the map of its direction set starts.
Interpolation Interpolate(int map_first, vec3 d) {
  int at = start_map[map_first + MapCell(d)];
  ivec4 corners = ivec4(0);
  vec3 w = vec3(0.0);
  for (int step = 0; step < 256 && at >= 0; ++step) {
    corners = triangles[2 * at];
    vec3 a = measured[corners.x].xyz, b = measured[corners.y].xyz, c = measured[corners.z].xyz;
    w = vec3(dot(d, cross(b, c)), dot(d, cross(c, a)), dot(d, cross(a, b)));
    w /= dot(a, cross(b, c));
    float lowest = min(w.x, min(w.y, w.z));
    if (lowest >= -1e-6) break;
    ivec4 neighbours = triangles[2 * at + 1];
    at = lowest == w.x ? neighbours.x : lowest == w.y ? neighbours.y : neighbours.z;
  }
  if (at < 0) return NearestOnHull(-1 - at, d);
  w = max(w, 0.0);
  return Interpolation(corners.xyz, w / (w.x + w.y + w.z), d);
}

// Beyond the measured cone of lights: the nearest direction's value scaled by the cosines, zero
// below the horizon.
float HorizonScale(vec3 nearest, vec3 l) {
  if (l.z <= 0.0) return 0.0;
  if (l.z >= kMaxHorizonScale * nearest.z) return kMaxHorizonScale;
  return l.z / nearest.z;
}
