#include "processing/codecs/per_texel/chain_fit.h"

#include <algorithm>

namespace mesorig::codecs::per_texel {
namespace {

constexpr double kTiny = 1e-9;  // of the mean denominator: nodes that nothing tells stay

// Calls function(node, weight) for the taps.
template <typename Function>
void ForTaps(const Taps& taps, const Function& function) {
  for (size_t i = 0; i < taps.count; ++i) function(taps.node[i], taps.weight[i]);
}

float At(const float* table, size_t step, const Taps& taps) {
  float sum = 0;
  ForTaps(taps, [&](size_t node, float w) { sum += w * table[node * step]; });
  return sum;
}

// Adds num / den to `table`, entry i at i.
void Step(const std::vector<double>& num, const std::vector<double>& den, float* table) {
  double mean = 0;
  for (const double d : den) mean += d / static_cast<double>(den.size());
  for (size_t i = 0; i < num.size(); ++i) {
    if (den[i] > kTiny * mean) table[i] += static_cast<float>(num[i] / den[i]);
  }
}

}  // namespace

ChainFitter::ChainFitter(const btf::BtfHeader& header, const std::vector<uint8_t>& present,
                         std::vector<Stage> stages)
    : stages_(std::move(stages)), layout_(LayoutOf(stages_, header)) {
  for (size_t pair = 0; pair < present.size(); ++pair) {
    if (present[pair] == 0) continue;
    pairs_.push_back(pair);
    taps_.push_back(TapsOf(stages_, header, static_cast<int>(pair / header.lights.size()),
                           static_cast<int>(pair % header.lights.size())));
  }
  others_.resize(3 * pairs_.size());
  rest_.resize(3 * pairs_.size());
  pq_.resize(4 * pairs_.size());
}

void ChainFitter::Evaluate(std::span<const float> texel, std::span<float> y) const {
  constexpr std::array<float, kMaxStages> kOnes = {1, 1};
  for (size_t i = 0; i < pairs_.size(); ++i) {
    const auto rgb = ProductOf(stages_, layout_, taps_[i], texel.data(), kOnes.data());
    std::copy(rgb.begin(), rgb.end(), y.begin() + static_cast<std::ptrdiff_t>(3 * i));
  }
}

void ChainFitter::StepP(size_t s, size_t k, std::span<const float> weights, std::span<float> texel) {
  const Layout::Tables& t = layout_.stages[s];
  num_.assign(t.p_nodes, 0.0);
  den_.assign(t.p_nodes, 0.0);
  for (size_t i = 0; i < pairs_.size(); ++i) {
    float num = 0, den = 0;
    for (size_t c = 0; c < 3; ++c) {
      const float m = others_[3 * i + c] * pq_[4 * i + 1 + c], w = weights[3 * i + c];
      num += w * m * rest_[3 * i + c];
      den += w * m * m;
    }
    ForTaps(taps_[i].p[s], [&](size_t node, float tap) {
      num_[node] += static_cast<double>(tap * num);
      den_[node] += static_cast<double>(tap * den);
    });
  }
  float* const table = texel.data() + t.p_first + k * t.p_nodes;
  Step(num_, den_, table);
  for (size_t i = 0; i < pairs_.size(); ++i) {
    const float p = At(table, 1, taps_[i].p[s]), change = p - pq_[4 * i];
    for (size_t c = 0; c < 3; ++c) rest_[3 * i + c] -= others_[3 * i + c] * pq_[4 * i + 1 + c] * change;
    pq_[4 * i] = p;
  }
}

void ChainFitter::StepQ(size_t s, size_t k, std::span<const float> weights, std::span<float> texel) {
  const Layout::Tables& t = layout_.stages[s];
  num_.assign(3 * t.q_nodes, 0.0);
  den_.assign(3 * t.q_nodes, 0.0);
  for (size_t i = 0; i < pairs_.size(); ++i) {
    for (size_t c = 0; c < 3; ++c) {
      const float m = others_[3 * i + c] * pq_[4 * i], w = weights[3 * i + c];
      ForTaps(taps_[i].q[s], [&](size_t node, float tap) {
        num_[3 * node + c] += static_cast<double>(tap * w * m * rest_[3 * i + c]);
        den_[3 * node + c] += static_cast<double>(tap * w * m * m);
      });
    }
  }
  float* const table = texel.data() + t.q_first + k * t.q_nodes * 3;
  Step(num_, den_, table);
  for (size_t i = 0; i < pairs_.size(); ++i) {
    for (size_t c = 0; c < 3; ++c) {
      const float q = At(table + c, 3, taps_[i].q[s]);
      rest_[3 * i + c] -= others_[3 * i + c] * pq_[4 * i] * (q - pq_[4 * i + 1 + c]);
      pq_[4 * i + 1 + c] = q;
    }
  }
}

void ChainFitter::RefineStage(size_t s, std::span<const float> y, std::span<const float> weights,
                              std::span<float> texel) {
  const Layout::Tables& t = layout_.stages[s];
  for (size_t i = 0; i < pairs_.size(); ++i) {
    std::array<float, 3> others{1, 1, 1};
    for (size_t o = 0; o < stages_.size(); ++o) {
      if (o == s) continue;
      const auto sum = StageSum(stages_[o], layout_.stages[o], taps_[i].p[o], taps_[i].q[o],
                                texel.data());
      for (size_t c = 0; c < 3; ++c) others[c] *= sum[c];
    }
    const auto own = StageSum(stages_[s], t, taps_[i].p[s], taps_[i].q[s], texel.data());
    for (size_t c = 0; c < 3; ++c) {
      others_[3 * i + c] = others[c];
      rest_[3 * i + c] = y[3 * i + c] - others[c] * own[c];
    }
  }
  for (size_t k = 0; k < static_cast<size_t>(stages_[s].terms); ++k) {
    const float* const p = texel.data() + t.p_first + k * t.p_nodes;
    const float* const q = texel.data() + t.q_first + k * t.q_nodes * 3;
    for (size_t i = 0; i < pairs_.size(); ++i) {
      pq_[4 * i] = t.p_nodes == 0 ? 1.0f : At(p, 1, taps_[i].p[s]);
      for (size_t c = 0; c < 3; ++c) pq_[4 * i + 1 + c] = At(q + c, 3, taps_[i].q[s]);
    }
    StepQ(s, k, weights, texel);
    if (t.p_nodes > 0) StepP(s, k, weights, texel);
  }
}

void ChainFitter::Refine(std::span<const float> y, std::span<const float> weights, int sweeps,
                         size_t first_stage, std::span<float> texel) {
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    for (size_t s = first_stage; s < stages_.size(); ++s) RefineStage(s, y, weights, texel);
  }
}

}  // namespace mesorig::codecs::per_texel
