#include "processing/codecs/per_texel/chain_btf.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/check.h"

namespace mesorig::codecs::per_texel {
namespace {

constexpr size_t kMostTaps = size_t{1} << 19;  // pairs: 64 MB of taps
constexpr float kLeastScale = 0x1p-60f, kMostScale = 0x1p60f;

float LargestOf(const float* values, size_t count) {
  float largest = 0;
  for (size_t i = 0; i < count; ++i) largest = std::max(largest, std::abs(values[i]));
  return largest;
}

// P of each term to a largest magnitude of 1 (in (1/2, 1]), Q of the stage too, by powers of two: what
// it takes is returned.
float BalanceStage(const Stage& stage, const Layout::Tables& t, float* texel) {
  const auto terms = static_cast<size_t>(stage.terms);
  for (size_t k = 0; k < terms && t.p_nodes > 0; ++k) {
    float* const p = texel + t.p_first + k * t.p_nodes;
    float* const q = texel + t.q_first + k * t.q_nodes * 3;
    const float scale = ScaleFor(LargestOf(p, t.p_nodes));
    for (size_t i = 0; i < t.p_nodes; ++i) p[i] /= scale;
    for (size_t i = 0; i < 3 * t.q_nodes; ++i) q[i] *= scale;
  }
  float* const q = texel + t.q_first;
  const size_t size = terms * t.q_nodes * 3;
  const float scale = std::clamp(ScaleFor(LargestOf(q, size)), kLeastScale, kMostScale);
  for (size_t i = 0; i < size; ++i) q[i] = std::clamp(q[i] / scale, -1.0f, 1.0f);
  return scale;
}

}  // namespace

ChainBtf::ChainBtf(btf::BtfFileInfo info, ChainFactors factors, btf::PairInterpolator interpolator)
    : info_(std::move(info)), factors_(std::move(factors)),
      layout_(LayoutOf(factors_.stages, info_.header)), interpolator_(std::move(interpolator)) {
  if (info_.present.size() > kMostTaps) return;
  const size_t lights = info_.header.lights.size();
  for (size_t pair = 0; pair < info_.present.size(); ++pair) {
    taps_.push_back(per_texel::TapsOf(factors_.stages, info_.header,
                                      static_cast<int>(pair / lights),
                                      static_cast<int>(pair % lights)));
  }
}

StatusOr<std::unique_ptr<EncodedBtf>> ChainBtf::Create(btf::BtfFileInfo info, ChainFactors factors) {
  MESORIG_ASSIGN_OR_RETURN(btf::PairInterpolator interpolator,
                           btf::PairInterpolator::Build(info.header, info.present));
  std::unique_ptr<ChainBtf> result(
      new ChainBtf(std::move(info), std::move(factors), std::move(interpolator)));
  const size_t texels = result->info_.header.texel_count();
  MESORIG_CHECK(result->factors_.stages.size() <= kMaxStages);
  const ChainFactors& f = result->factors_;
  MESORIG_CHECK(f.scales.size() == texels * f.stages.size());
  if (f.clusters.empty()) {
    MESORIG_CHECK(f.values.size() == texels * result->layout_.size);
  } else {
    MESORIG_CHECK(f.clusters.size() == f.scales.size());
    const size_t last = *std::max_element(f.clusters.begin(), f.clusters.end());
    MESORIG_CHECK((last + 1) * result->layout_.size <= f.values.size());
  }
  return std::unique_ptr<EncodedBtf>(std::move(result));
}

std::array<float, 3> ChainBtf::Value(const PairTaps& taps, size_t texel) const {
  TableRows rows{};
  for (size_t s = 0; s < factors_.stages.size(); ++s) {
    rows[s] = factors_.values.data() + factors_.RowOf(texel, s) * layout_.size;
  }
  auto rgb = ProductOf(factors_.stages, layout_, taps, rows,
                       factors_.scales.data() + texel * factors_.stages.size());
  for (float& x : rgb) x -= factors_.floor;
  return rgb;
}

std::array<float, 3> ChainBtf::Value(int view, int light, size_t texel) const {
  if (taps_.empty()) return Value(TapsOf(factors_.stages, info_.header, view, light), texel);
  return Value(taps_[static_cast<size_t>(view) * info_.header.lights.size() +
                     static_cast<size_t>(light)],
               texel);
}

void ChainBtf::DecodeImage(int view, int light, std::span<float> rgb) const {
  const PairTaps taps = TapsOf(factors_.stages, info_.header, view, light);
  for (size_t i = 0; i < info_.header.texel_count(); ++i) {
    const auto value = Value(taps, i);
    std::copy(value.begin(), value.end(), rgb.begin() + static_cast<std::ptrdiff_t>(3 * i));
  }
}

std::array<float, 3> ChainBtf::Evaluate(int x, int y, Vec3 v, Vec3 l) const {
  const btf::PairWeights pairs = interpolator_.Lookup(v, l);
  const size_t texel = static_cast<size_t>(y) * static_cast<size_t>(info_.header.width) +
                       static_cast<size_t>(x);
  std::array<float, 3> rgb{};
  for (size_t n = 0; n < static_cast<size_t>(pairs.count); ++n) {
    const auto value = Value(pairs.view[n], pairs.light[n], texel);
    const float weight = pairs.scale * pairs.weight[n];
    for (size_t c = 0; c < 3; ++c) rgb[c] += weight * value[c];
  }
  return rgb;
}

void ChainBtf::DecodeSamples(std::span<const NodeQuery> queries,
                             std::span<std::array<float, 3>> out) const {
  const auto width = static_cast<size_t>(info_.header.width);
  for (size_t i = 0; i < queries.size(); ++i) {
    const auto& [x, y, view, light] = queries[i];
    out[i] = Value(view, light, static_cast<size_t>(y) * width + static_cast<size_t>(x));
  }
}

std::vector<float> TablesOfTexels(const ChainFactors& f, const Layout& layout, bool unscale) {
  const size_t stages = f.stages.size(), texels = f.scales.size() / stages;
  std::vector<float> tables(texels * layout.size, 0.0f);
  for (size_t i = 0; i < texels; ++i) {
    for (size_t s = 0; s < stages; ++s) {
      const Layout::Tables& t = layout.stages[s];
      const auto terms = static_cast<size_t>(f.stages[s].terms);
      const float* const from = f.values.data() + f.RowOf(i, s) * layout.size;
      float* const to = tables.data() + i * layout.size;
      const float scale = unscale ? f.scales[i * stages + s] : 1.0f;
      std::copy_n(from + t.p_first, terms * t.p_nodes, to + t.p_first);
      std::transform(from + t.q_first, from + t.q_first + terms * t.q_nodes * 3, to + t.q_first,
                     [scale](float q) { return scale * q; });
    }
  }
  return tables;
}

ChainFactors Balanced(std::vector<Stage> stages, const btf::BtfHeader& header,
                      Quantisation quantisation, float floor, std::vector<float> values) {
  const Layout layout = LayoutOf(stages, header);
  ChainFactors factors{std::move(stages), quantisation, floor, std::move(values), {}, {}};
  for (size_t i = 0; i * layout.size < factors.values.size(); ++i) {
    for (size_t s = 0; s < factors.stages.size(); ++s) {
      factors.scales.push_back(BalanceStage(factors.stages[s], layout.stages[s],
                                            factors.values.data() + i * layout.size));
    }
  }
  RoundTo(quantisation, factors.values);
  return factors;
}

void BalanceRows(const Layout& layout, ChainFactors& f) {
  const size_t stages = f.stages.size(), rows = f.values.size() / layout.size;
  std::vector<float> of_rows(rows * stages);
  for (size_t k = 0; k < of_rows.size(); ++k) {
    of_rows[k] = BalanceStage(f.stages[k % stages], layout.stages[k % stages],
                              f.values.data() + k / stages * layout.size);
  }
  for (size_t i = 0; i < f.scales.size(); ++i) {
    const float scale = f.scales[i] * of_rows[f.clusters[i] * stages + i % stages];
    f.scales[i] = std::clamp(scale, kLeastScale, kMostScale);
  }
  RoundTo(f.quantisation, f.values);
}

}  // namespace mesorig::codecs::per_texel
