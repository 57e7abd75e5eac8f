#include "processing/codecs/space_filter.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/check.h"

namespace mesorig::codecs {
namespace {

// One axis of one mip level.
struct LevelAxis {
  int texels = 1;        // of the level
  double footprint = 1;  // texels of the BTF that one of them covers
};

LevelAxis AxisOf(int size, int level) {
  const int texels = std::max(1, level < 31 ? size >> level : 0);
  return {texels, static_cast<double>(size) / texels};
}

int Wrapped(double index, int size) {
  return static_cast<int>(index - std::floor(index / size) * size) % size;
}

// Mean over the area of texel (i, j) of the level.
std::array<double, 3> MeanOver(const TexelValue& texel, LevelAxis x, LevelAxis y, int i, int j) {
  const double left = i * x.footprint, right = left + x.footprint;
  const double top = j * y.footprint, bottom = top + y.footprint;
  const int width = static_cast<int>(std::lround(x.texels * x.footprint));
  const int height = static_cast<int>(std::lround(y.texels * y.footprint));
  std::array<double, 3> sum{};
  double area = 0;
  for (int b = static_cast<int>(top); b < std::min<double>(std::ceil(bottom), height); ++b) {
    const double down = std::min(bottom, b + 1.0) - std::max<double>(top, b);
    for (int a = static_cast<int>(left); a < std::min<double>(std::ceil(right), width); ++a) {
      const double weight = down * (std::min(right, a + 1.0) - std::max<double>(left, a));
      const std::array<float, 3> value = texel(a, b);
      for (size_t c = 0; c < 3; ++c) sum[c] += weight * static_cast<double>(value[c]);
      area += weight;
    }
  }
  for (double& s : sum) s /= area;
  return sum;
}

std::array<double, 3> BilinearAt(int width, int height, const TexelValue& texel, double u, double v,
                                 int level) {
  const LevelAxis across = AxisOf(width, level), down = AxisOf(height, level);
  const double x = u * across.texels - 0.5, y = v * down.texels - 0.5;
  const double x0 = std::floor(x), y0 = std::floor(y);
  std::array<double, 3> sum{};
  for (int j = 0; j < 2; ++j) {
    for (int i = 0; i < 2; ++i) {
      const double weight = (i == 0 ? 1 - (x - x0) : x - x0) * (j == 0 ? 1 - (y - y0) : y - y0);
      if (weight == 0) continue;
      const auto mean = MeanOver(texel, across, down, Wrapped(x0 + i, across.texels),
                                 Wrapped(y0 + j, down.texels));
      for (size_t c = 0; c < 3; ++c) sum[c] += weight * mean[c];
    }
  }
  return sum;
}

}  // namespace

std::array<double, 3> FilteredInSpace(int width, int height, const TexelValue& texel, double u,
                                      double v, double level) {
  MESORIG_CHECK(std::isfinite(u) && std::isfinite(v) && level >= 0 && std::isfinite(level));
  const double most = std::floor(std::log2(std::max(width, height)));
  level = std::min(level, most);
  const int below = static_cast<int>(level);
  const double between = level - below;
  auto value = BilinearAt(width, height, texel, u, v, below);
  if (between == 0) return value;
  const auto above = BilinearAt(width, height, texel, u, v, below + 1);
  for (size_t c = 0; c < 3; ++c) value[c] += between * (above[c] - value[c]);
  return value;
}

std::array<double, 3> EvaluateFiltered(const EncodedBtf& btf, double u, double v, double level,
                                       Vec3 view, Vec3 light) {
  const btf::BtfHeader& header = btf.info().header;
  return FilteredInSpace(
      header.width, header.height, [&](int x, int y) { return btf.Evaluate(x, y, view, light); }, u,
      v, level);
}

}  // namespace mesorig::codecs
