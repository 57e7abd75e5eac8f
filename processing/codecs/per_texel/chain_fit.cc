#include "processing/codecs/per_texel/chain_fit.h"

#include <algorithm>
#include <array>

namespace mesorig::codecs::per_texel {
namespace {

constexpr size_t kLanes = 8;
constexpr float kTiny = 1e-9f;  // of the mean denominator: nodes that nothing tells stay

// One number of each of eight texels.
using Vector = float __attribute__((vector_size(kLanes * sizeof(float))));

}  // namespace

struct ChainFitter::Lanes {
  Vector x;
};

struct ChainFitter::Work {
  std::vector<Lanes> y;       // three a pair
  std::vector<Lanes> tables;  // in the order of Layout
  std::array<std::vector<Lanes>, kMaxStages> sums;  // what each stage says, three a pair
  std::vector<Lanes> num, den, change;              // of a table's step

  // What is not explained yet of channel c of pair i.
  Vector Rest(size_t i, size_t c, size_t stages) const {
    Vector product = sums[0][3 * i + c].x;
    for (size_t s = 1; s < stages; ++s) product *= sums[s][3 * i + c].x;
    return y[3 * i + c].x - product;
  }
  // What the other stages multiply stage s by.
  Vector Others(size_t s, size_t i, size_t c, size_t stages) const {
    if (stages == 1) return Vector{} + 1.0f;
    return sums[1 - s][3 * i + c].x;
  }
  void Clear(size_t size) {
    num.assign(size, Lanes());
    den.assign(size, Lanes());
    change.resize(size);
  }
  // Adds num / den to the table that begins at `first`; `change` is what was added.
  void Step(size_t first) {
    Vector mean{};
    for (const Lanes& d : den) mean += d.x;
    mean /= static_cast<float>(den.size());
    for (size_t i = 0; i < num.size(); ++i) {
      const Vector tells = den[i].x > kTiny * mean ? Vector{} + 1.0f : Vector{};
      // Where nothing tells, 0 / 1.
      change[i].x = tells * num[i].x / (tells * den[i].x + (1.0f - tells));
      tables[first + i].x += change[i].x;
    }
  }
};

namespace {

// A table at the taps. `step`: numbers from node to node.
template <typename Lanes>
Vector At(const Lanes* table, size_t step, const Taps& taps) {
  Vector sum = taps.weight[0] * table[taps.node[0] * step].x;
  for (size_t i = 1; i < taps.count; ++i) sum += taps.weight[i] * table[taps.node[i] * step].x;
  return sum;
}

template <typename Lanes>
void AddAt(Lanes* table, size_t step, const Taps& taps, const Vector& value) {
  for (size_t i = 0; i < taps.count; ++i) table[taps.node[i] * step].x += taps.weight[i] * value;
}

}  // namespace

ChainFitter::ChainFitter(const btf::BtfHeader& header, const std::vector<uint8_t>& present,
                         std::vector<Stage> stages)
    : stages_(std::move(stages)), layout_(LayoutOf(stages_, header)),
      work_(std::make_unique<Work>()) {
  for (size_t pair = 0; pair < present.size(); ++pair) {
    if (present[pair] == 0) continue;
    pairs_.push_back(pair);
    taps_.push_back(TapsOf(stages_, header, static_cast<int>(pair / header.lights.size()),
                           static_cast<int>(pair % header.lights.size())));
  }
}

ChainFitter::ChainFitter(const ChainFitter& other)
    : stages_(other.stages_), layout_(other.layout_), pairs_(other.pairs_), taps_(other.taps_),
      work_(std::make_unique<Work>()) {}
ChainFitter::ChainFitter(ChainFitter&&) noexcept = default;
ChainFitter::~ChainFitter() = default;

void ChainFitter::Evaluate(std::span<const float> texel, std::span<float> y) const {
  constexpr std::array<float, kMaxStages> kOnes = {1, 1};
  const TableRows rows = {texel.data(), texel.data()};
  for (size_t i = 0; i < pairs_.size(); ++i) {
    const auto rgb = ProductOf(stages_, layout_, taps_[i], rows, kOnes.data());
    std::copy(rgb.begin(), rgb.end(), y.begin() + static_cast<std::ptrdiff_t>(3 * i));
  }
}

void ChainFitter::SumStage(size_t s) {
  const Layout::Tables& t = layout_.stages[s];
  work_->sums[s].assign(3 * pairs_.size(), Lanes());
  for (size_t k = 0; k < static_cast<size_t>(stages_[s].terms); ++k) {
    const Lanes* const p = work_->tables.data() + t.p_first + k * t.p_nodes;
    const Lanes* const q = work_->tables.data() + t.q_first + k * t.q_nodes * 3;
    for (size_t i = 0; i < pairs_.size(); ++i) {
      const Vector at_p = t.p_nodes == 0 ? Vector{} + 1.0f : At(p, 1, taps_[i].p[s]);
      for (size_t c = 0; c < 3; ++c) {
        work_->sums[s][3 * i + c].x += at_p * At(q + c, 3, taps_[i].q[s]);
      }
    }
  }
}

void ChainFitter::StepQ(size_t s, size_t k, std::span<const float> weights) {
  Work& w = *work_;
  const Layout::Tables& t = layout_.stages[s];
  const size_t first = t.q_first + k * t.q_nodes * 3;
  const Lanes* const p = w.tables.data() + t.p_first + k * t.p_nodes;
  w.Clear(3 * t.q_nodes);
  for (size_t i = 0; i < pairs_.size(); ++i) {
    const Vector at_p = t.p_nodes == 0 ? Vector{} + 1.0f : At(p, 1, taps_[i].p[s]);
    for (size_t c = 0; c < 3; ++c) {
      const Vector m = w.Others(s, i, c, stages_.size()) * at_p, wm = weights[3 * i + c] * m;
      AddAt(w.num.data() + c, 3, taps_[i].q[s], wm * w.Rest(i, c, stages_.size()));
      AddAt(w.den.data() + c, 3, taps_[i].q[s], wm * m);
    }
  }
  w.Step(first);
  for (size_t i = 0; i < pairs_.size(); ++i) {
    const Vector at_p = t.p_nodes == 0 ? Vector{} + 1.0f : At(p, 1, taps_[i].p[s]);
    for (size_t c = 0; c < 3; ++c) {
      w.sums[s][3 * i + c].x += at_p * At(w.change.data() + c, 3, taps_[i].q[s]);
    }
  }
}

void ChainFitter::StepP(size_t s, size_t k, std::span<const float> weights) {
  Work& w = *work_;
  const Layout::Tables& t = layout_.stages[s];
  const Lanes* const q = w.tables.data() + t.q_first + k * t.q_nodes * 3;
  w.Clear(t.p_nodes);
  for (size_t i = 0; i < pairs_.size(); ++i) {
    Vector num{}, den{};
    for (size_t c = 0; c < 3; ++c) {
      const Vector m = w.Others(s, i, c, stages_.size()) * At(q + c, 3, taps_[i].q[s]);
      const Vector wm = weights[3 * i + c] * m;
      num += wm * w.Rest(i, c, stages_.size());
      den += wm * m;
    }
    AddAt(w.num.data(), 1, taps_[i].p[s], num);
    AddAt(w.den.data(), 1, taps_[i].p[s], den);
  }
  w.Step(t.p_first + k * t.p_nodes);
  for (size_t i = 0; i < pairs_.size(); ++i) {
    const Vector change = At(w.change.data(), 1, taps_[i].p[s]);
    for (size_t c = 0; c < 3; ++c) {
      w.sums[s][3 * i + c].x += change * At(q + c, 3, taps_[i].q[s]);
    }
  }
}

void ChainFitter::RefineEight(std::span<const float> weights, int sweeps, size_t first_stage) {
  for (size_t s = 0; s < stages_.size(); ++s) SumStage(s);
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    for (size_t s = first_stage; s < stages_.size(); ++s) {
      for (size_t k = 0; k < static_cast<size_t>(stages_[s].terms); ++k) {
        StepQ(s, k, weights);
        if (layout_.stages[s].p_nodes > 0) StepP(s, k, weights);
      }
    }
  }
}

void ChainFitter::Refine(std::span<const float> y, std::span<const float> weights, int sweeps,
                         size_t first_stage, std::span<float> texels) {
  const size_t samples = 3 * pairs_.size(), size = layout_.size, count = texels.size() / size;
  for (size_t first = 0; first < count; first += kLanes) {
    const size_t lanes = std::min(kLanes, count - first);
    work_->y.assign(samples, Lanes());
    work_->tables.assign(size, Lanes());
    for (size_t t = 0; t < lanes; ++t) {
      for (size_t i = 0; i < samples; ++i) work_->y[i].x[t] = y[(first + t) * samples + i];
      for (size_t i = 0; i < size; ++i) work_->tables[i].x[t] = texels[(first + t) * size + i];
    }
    RefineEight(weights, sweeps, first_stage);
    for (size_t t = 0; t < lanes; ++t) {
      for (size_t i = 0; i < size; ++i) texels[(first + t) * size + i] = work_->tables[i].x[t];
    }
  }
}

}  // namespace mesorig::codecs::per_texel
