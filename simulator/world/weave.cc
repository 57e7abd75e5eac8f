#include "simulator/world/weave.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/geometry.h"

namespace mesorig::world {
namespace {

enum class Part { kGround, kWarp, kWeft };

struct Thread {
  double height = -1;  // below the ground: no thread here
  double across = 0;   // -1..1
};

// The thread that runs along `along`, where `across` runs over the threads. `sign` +1 for the warp,
// -1 for the weft, which is under where the warp is over.
Thread ThreadAt(const WeaveShape& s, double across, double along, double sign) {
  const double index = std::floor(across / s.pitch_mm);
  const double u = (across - (index + 0.5) * s.pitch_mm) / (0.5 * s.thread_width_mm);
  if (std::abs(u) > 1) return {};
  const double sway = sign * s.sway_mm * std::cos(kPi * (along / s.pitch_mm - 0.5 - index));
  return {s.base_mm + sway + s.thread_height_mm * (1 - u * u), u};
}

struct Top {
  double height = 0;
  Part part = Part::kGround;
  double across = 0, along = 0;
};

Top TopAt(const WeaveShape& s, double x, double y) {
  const Thread warp = ThreadAt(s, x, y, 1), weft = ThreadAt(s, y, x, -1);
  Top top;
  if (warp.height > top.height) top = {warp.height, Part::kWarp, warp.across, y};
  if (weft.height > top.height) top = {weft.height, Part::kWeft, weft.across, x};
  return top;
}

// Distance from an axis-aligned rectangle; negative inside.
double RectangleDistance(double x, double y, double x0, double x1, double y0, double y1) {
  const double dx = std::max(x0 - x, x - x1), dy = std::max(y0 - y, y - y1);
  return std::min(std::max(dx, dy), 0.0) + std::hypot(std::max(dx, 0.0), std::max(dy, 0.0));
}

double LetterDistance(const WeaveShape& s, double x, double y) {
  const double w = s.letter_stroke_mm;
  const double left = s.letter_x_mm - s.letter_width_mm / 2, right = left + s.letter_width_mm;
  const double bottom = s.letter_y_mm - s.letter_height_mm / 2, top = bottom + s.letter_height_mm;
  const double middle = bottom + 0.46 * s.letter_height_mm;
  return std::min({RectangleDistance(x, y, left, left + w, bottom, top),
                   RectangleDistance(x, y, left, right, top - w, top),
                   RectangleDistance(x, y, left, left + 0.8 * s.letter_width_mm, middle - w / 2,
                                     middle + w / 2)});
}

Material Mix(const Material& a, const Material& b, double t) {
  Material m;
  for (int c = 0; c < 3; ++c) m.diffuse[c] = a.diffuse[c] + t * (b.diffuse[c] - a.diffuse[c]);
  m.specular = a.specular + t * (b.specular - a.specular);
  m.roughness = a.roughness + t * (b.roughness - a.roughness);
  return m;
}

}  // namespace

double LetterCoverage(const WeaveShape& s, double x, double y) {
  const double t = std::clamp(0.5 - LetterDistance(s, x, y) / s.letter_ramp_mm, 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

double WeaveHeight(const WeaveShape& s, double x, double y) {
  const double weave = TopAt(s, x, y).height;
  const double coverage = LetterCoverage(s, x, y);
  return weave + coverage * (s.letter_top_mm + s.letter_follow * weave - weave);
}

Material WeaveMaterial(const WeaveShape& s, double x, double y) {
  const Top top = TopAt(s, x, y);
  Material material = s.ground;
  if (top.part != Part::kGround) {
    material = top.part == Part::kWarp ? s.warp : s.weft;
    const double phase = 2 * kPi * (top.along / s.twist_mm + 0.35 * top.across);
    for (double& albedo : material.diffuse) albedo *= 1 + s.twist_contrast * std::sin(phase);
  }
  return Mix(material, s.letter, LetterCoverage(s, x, y));
}

}  // namespace mesorig::world
