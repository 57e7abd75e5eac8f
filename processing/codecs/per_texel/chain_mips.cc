#include <algorithm>
#include <cmath>

#include "processing/codecs/per_texel/chain_btf.h"
#include "processing/codecs/per_texel/chain_fit.h"

namespace mesorig::codecs::per_texel {
namespace {

constexpr int kSweeps = 8;
constexpr int kTogether = 8;  // texels, as the fitter takes them

struct Level {
  int width = 0, height = 0;
  std::vector<float> values;  // scales multiplied in
};

// The mean of what the texels below texel i of `coarse` say is added to y; the first of them is where
// its tables start.
void Gather(const ChainFitter& fitter, const Level& fine, const Level& coarse, int i,
            std::span<float> y, std::vector<float>& texels) {
  const size_t size = fitter.layout().size;
  std::vector<size_t> below;
  for (int dy = 0; dy < (fine.height > 1 ? 2 : 1); ++dy) {
    for (int dx = 0; dx < (fine.width > 1 ? 2 : 1); ++dx) {
      below.push_back(static_cast<size_t>((i / coarse.width * 2 + dy) * fine.width +
                                          i % coarse.width * 2 + dx));
    }
  }
  std::vector<float> one(y.size());
  for (const size_t t : below) {
    fitter.Evaluate(std::span(fine.values).subspan(t * size, size), one);
    for (size_t k = 0; k < y.size(); ++k) y[k] += one[k] / static_cast<float>(below.size());
  }
  const auto first = fine.values.begin() + static_cast<std::ptrdiff_t>(below[0] * size);
  texels.insert(texels.end(), first, first + static_cast<std::ptrdiff_t>(size));
}

Level Coarser(ChainFitter& fitter, const Level& fine) {
  Level coarse{std::max(1, fine.width / 2), std::max(1, fine.height / 2), {}};
  const size_t size = fitter.layout().size, samples = 3 * fitter.pairs().size();
  const std::vector<float> weights(samples, 1.0f);
  const int all = coarse.width * coarse.height;
  for (int first = 0; first < all; first += kTogether) {
    const int count = std::min(kTogether, all - first);
    std::vector<float> y(static_cast<size_t>(count) * samples, 0.0f), start;
    for (int i = 0; i < count; ++i) {
      Gather(fitter, fine, coarse, first + i,
             std::span(y).subspan(static_cast<size_t>(i) * samples, samples), start);
    }
    std::vector<float> texels = start;
    fitter.Refine(y, weights, kSweeps, 0, texels);
    for (size_t i = 0; i < texels.size(); i += size) {
      const auto texel = texels.begin() + static_cast<std::ptrdiff_t>(i);
      const auto end = texel + static_cast<std::ptrdiff_t>(size);
      // Of factors that no encoder makes, whose products leave float.
      if (!std::all_of(texel, end, [](float x) { return std::isfinite(x); })) {
        std::copy_n(start.begin() + static_cast<std::ptrdiff_t>(i), size, texel);
      }
    }
    coarse.values.insert(coarse.values.end(), texels.begin(), texels.end());
  }
  return coarse;
}

}  // namespace

ChainMips FitMips(const btf::BtfFileInfo& info, const ChainFactors& factors) {
  ChainFitter fitter(info.header, info.present, factors.stages);
  Level level{info.header.width, info.header.height,
              TablesOfTexels(factors, fitter.layout(), /*unscale=*/true)};
  ChainMips mips;
  while (level.width > 1 || level.height > 1) {
    level = Coarser(fitter, level);
    const ChainFactors balanced = Balanced(factors.stages, info.header, Quantisation::kFloat,
                                           factors.floor, level.values);
    mips.values.insert(mips.values.end(), balanced.values.begin(), balanced.values.end());
    mips.scales.insert(mips.scales.end(), balanced.scales.begin(), balanced.scales.end());
  }
  return mips;
}

}  // namespace mesorig::codecs::per_texel
