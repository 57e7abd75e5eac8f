#include "processing/codecs/per_texel/chain.h"

#include <algorithm>
#include <cmath>

namespace mesorig::codecs::per_texel {
namespace {

float Interpolated(const float* table, size_t step, const Taps& taps) {
  float sum = 0;
  for (size_t i = 0; i < taps.count; ++i) sum += taps.weight[i] * table[taps.node[i] * step];
  return sum;
}

Taps OneNode(int node) {
  Taps taps;
  taps.node[0] = static_cast<uint16_t>(node);
  return taps;
}

Taps GridTaps(Vec3 d) {
  const auto [x, y] = GridPlace(d);
  const int x0 = std::min(static_cast<int>(x), kGrid - 2);
  const int y0 = std::min(static_cast<int>(y), kGrid - 2);
  const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
  Taps taps;
  taps.count = 4;
  for (int i = 0; i < 4; ++i) {
    const int dx = i % 2, dy = i / 2;
    taps.node[static_cast<size_t>(i)] = static_cast<uint16_t>((y0 + dy) * kGrid + x0 + dx);
    taps.weight[static_cast<size_t>(i)] = (dx == 1 ? fx : 1 - fx) * (dy == 1 ? fy : 1 - fy);
  }
  return taps;
}

Taps AxisTaps(Axis axis, const btf::BtfHeader& header, int view, int light) {
  const Vec3 v = header.views[static_cast<size_t>(view)];
  const Vec3 l = header.lights[static_cast<size_t>(light)];
  switch (axis) {
    case Axis::kNone:
      return {};
    case Axis::kView:
      return OneNode(view);
    case Axis::kLight:
      return OneNode(light);
    case Axis::kHalf:
      return GridTaps(HalfVector(v, l));
    case Axis::kDifference:
      return GridTaps(Difference(v, l));
  }
  return {};
}

}  // namespace

int NodesOf(Axis axis, const btf::BtfHeader& header) {
  switch (axis) {
    case Axis::kNone:
      return 0;
    case Axis::kView:
      return header.view_count();
    case Axis::kLight:
      return header.light_count();
    case Axis::kHalf:
    case Axis::kDifference:
      return kGrid * kGrid;
  }
  return 0;
}

Layout LayoutOf(const std::vector<Stage>& stages, const btf::BtfHeader& header) {
  Layout layout;
  for (size_t s = 0; s < stages.size(); ++s) {
    Layout::Tables& t = layout.stages[s];
    const auto terms = static_cast<size_t>(stages[s].terms);
    t.p_nodes = static_cast<size_t>(NodesOf(stages[s].p, header));
    t.q_nodes = static_cast<size_t>(NodesOf(stages[s].q, header));
    t.p_first = layout.size;
    t.q_first = (t.p_first + terms * t.p_nodes + 2) / 3 * 3;
    layout.size = t.q_first + terms * t.q_nodes * 3;
  }
  return layout;
}

// Equal areas of hemisphere and disk, concentric squares to concentric circles.
std::array<float, 2> GridPlace(Vec3 d) {
  const double z = std::clamp(d.z, 0.0, 1.0), r = std::sqrt(1 - z);
  const double across = std::hypot(d.x, d.y);
  if (across <= 0) return {(kGrid - 1) / 2.0f, (kGrid - 1) / 2.0f};
  const double x = d.x / across, y = d.y / across;
  const double larger = r, smaller = r * 4 / kPi * std::atan2(std::min(std::abs(x), std::abs(y)),
                                                             std::max(std::abs(x), std::abs(y)));
  const bool along_x = std::abs(x) >= std::abs(y);
  const double a = std::copysign(along_x ? larger : smaller, x);
  const double b = std::copysign(along_x ? smaller : larger, y);
  const auto place = [](double t) {
    return static_cast<float>(std::clamp((t + 1) / 2, 0.0, 1.0) * (kGrid - 1));
  };
  return {place(a), place(b)};
}

Vec3 HalfVector(Vec3 v, Vec3 l) {
  const Vec3 sum = v + l;
  return Norm(sum) > 1e-9 ? Normalized(sum) : Vec3{0, 0, 1};
}

Vec3 Difference(Vec3 v, Vec3 l) {
  const Vec3 h = HalfVector(v, l);
  if (h.z < -0.999999) return {l.x, -l.y, -l.z};
  // The turn that takes h to +z about h x z: for a vector d,
  // d -> d - (d.h + d.z) / (1 + h.z) (h + z) + 2 (d.h) z.
  const double dh = Dot(l, h);
  const Vec3 z{0, 0, 1};
  return Normalized(l - (dh + l.z) / (1 + h.z) * (h + z) + 2 * dh * z);
}

PairTaps TapsOf(const std::vector<Stage>& stages, const btf::BtfHeader& header, int view, int light) {
  PairTaps taps;
  for (size_t s = 0; s < stages.size(); ++s) {
    taps.p[s] = AxisTaps(stages[s].p, header, view, light);
    taps.q[s] = AxisTaps(stages[s].q, header, view, light);
  }
  return taps;
}

std::array<float, 3> StageSum(const Stage& stage, const Layout::Tables& tables, const Taps& p,
                              const Taps& q, const float* texel) {
  std::array<float, 3> sum{};
  for (size_t k = 0; k < static_cast<size_t>(stage.terms); ++k) {
    const float a = tables.p_nodes == 0
                        ? 1.0f
                        : Interpolated(texel + tables.p_first + k * tables.p_nodes, 1, p);
    const float* const rgb = texel + tables.q_first + k * tables.q_nodes * 3;
    for (size_t c = 0; c < 3; ++c) sum[c] += a * Interpolated(rgb + c, 3, q);
  }
  return sum;
}

std::array<float, 3> ProductOf(const std::vector<Stage>& stages, const Layout& layout,
                               const PairTaps& taps, const TableRows& rows, const float* scales) {
  std::array<float, 3> product{1, 1, 1};
  for (size_t s = 0; s < stages.size(); ++s) {
    const auto sum = StageSum(stages[s], layout.stages[s], taps.p[s], taps.q[s], rows[s]);
    for (size_t c = 0; c < 3; ++c) product[c] *= sum[c] * scales[s];
  }
  return product;
}

}  // namespace mesorig::codecs::per_texel
