#include "processing/codecs/per_texel/cluster_tables.h"

#include <algorithm>
#include <cmath>

#include "processing/codecs/algebra/local_pca.h"

namespace mesorig::codecs::per_texel {
namespace {

constexpr int64_t kCoordinates = 64;   // of a stage's tables, to cluster in
constexpr float kLeastWeight = 1e-3f;  // of the mean: dark texels have clusters too
constexpr float kLeastScale = 0x1p-60f, kMostScale = 0x1p60f;

// Brings `count` numbers to a root mean square of 1; returns what it was, 0 where all are 0.
float Normalise(float* values, size_t count) {
  double square = 0;
  for (size_t i = 0; i < count; ++i) square += static_cast<double>(values[i]) * values[i];
  const auto rms = static_cast<float>(std::sqrt(square / static_cast<double>(count)));
  if (!(rms > 0) || !std::isfinite(rms)) return 0;
  for (size_t i = 0; i < count; ++i) values[i] /= rms;
  return rms;
}

// P of every term, then Q of the stage, to a root mean square of 1: products say nothing of how they
// are shared out. Returns the scale.
float NormaliseStage(const Stage& stage, const Layout::Tables& t, float* texel) {
  const auto terms = static_cast<size_t>(stage.terms);
  for (size_t k = 0; k < terms && t.p_nodes > 0; ++k) {
    const float rms = Normalise(texel + t.p_first + k * t.p_nodes, t.p_nodes);
    float* const q = texel + t.q_first + k * t.q_nodes * 3;
    for (size_t i = 0; i < 3 * t.q_nodes; ++i) q[i] *= rms;
  }
  return Normalise(texel + t.q_first, terms * t.q_nodes * 3);
}

// A stage's tables: a row a texel, columns so that each table weighs alike, and directions as they are
// weighted.
class StageRows final : public algebra::RowSource {
 public:
  StageRows(const Stage& stage, const Layout::Tables& t, size_t size, const ChainWeights& directions,
            const std::vector<float>& values, const std::vector<float>& weights)
      : size_(size), values_(values), weights_(weights) {
    const auto terms = static_cast<size_t>(stage.terms);
    const auto add = [&](Axis axis, size_t first, size_t nodes, size_t colours) {
      const auto alike = 1 / std::sqrt(static_cast<float>(nodes * colours));
      for (size_t i = 0; i < terms * nodes * colours; ++i) {
        const size_t node = i / colours % nodes;
        const float weight = axis == Axis::kView    ? directions.view[node]
                             : axis == Axis::kLight ? directions.light[node]
                                                    : 1.0f;
        columns_.emplace_back(first + i, alike * weight);
      }
    };
    if (t.p_nodes > 0) add(stage.p, t.p_first, t.p_nodes, 1);
    add(stage.q, t.q_first, t.q_nodes, 3);
  }
  int64_t rows() const override { return static_cast<int64_t>(weights_.size()); }
  int64_t cols() const override { return static_cast<int64_t>(columns_.size()); }
  StatusOr<algebra::ViewF> Rows(int64_t first, int64_t count, float* scratch) const override {
    float* out = scratch;
    for (const auto& [column, weight] : columns_) {
      for (int64_t i = 0; i < count; ++i) {
        const auto texel = static_cast<size_t>(first + i);
        *out++ = weight * weights_[texel] * values_[texel * size_ + column];
      }
    }
    return algebra::ViewF(scratch, count, cols(), count);
  }

 private:
  size_t size_;
  const std::vector<float>&values_, &weights_;
  std::vector<std::pair<size_t, float>> columns_;
};

// The weighted means of one stage's tables, into rows of `means`.
void AddMeans(const Stage& stage, const Layout::Tables& t, size_t size,
              const std::vector<float>& values, const std::vector<float>& weights,
              const std::vector<int>& cluster, std::vector<double>& means) {
  const auto terms = static_cast<size_t>(stage.terms);
  std::vector<double> total(means.size() / size, 0.0);
  for (size_t i = 0; i < cluster.size(); ++i) {
    total[static_cast<size_t>(cluster[i])] += static_cast<double>(weights[i]) * weights[i];
  }
  for (size_t i = 0; i < cluster.size(); ++i) {
    const auto k = static_cast<size_t>(cluster[i]);
    const double share = static_cast<double>(weights[i]) * weights[i] / total[k];
    const auto add = [&](size_t first, size_t count) {
      for (size_t j = first; j < first + count; ++j) {
        means[k * size + j] += share * values[i * size + j];
      }
    };
    add(t.p_first, terms * t.p_nodes);
    add(t.q_first, terms * t.q_nodes * 3);
  }
}

// The scale of each texel that brings its clusters' product nearest to what its own tables say.
Status FitScales(const ChainFitter& fitter, const ChainWeights& weights,
                 const std::vector<float>& values, const std::vector<float>& scales,
                 ChainFactors& factors) {
  const size_t size = fitter.layout().size, stages = fitter.stages().size();
  const size_t texels = values.size() / size, samples = 3 * fitter.pairs().size();
  const int workers = algebra::Threads();
  return algebra::ForParts(
      workers, static_cast<int64_t>(texels), static_cast<int64_t>((texels + workers - 1) / workers),
      [&](int, int64_t first, int64_t count) {
        std::vector<float> own(samples), means(samples), row(size);
        for (auto i = static_cast<size_t>(first); i < static_cast<size_t>(first + count); ++i) {
          fitter.Evaluate(std::span(values).subspan(i * size, size), own);
          for (size_t s = 0; s < stages; ++s) {
            const size_t begin = fitter.layout().stages[s].p_first;
            const size_t end = s + 1 < stages ? fitter.layout().stages[s + 1].p_first : size;
            const float* const from = factors.values.data() + factors.RowOf(i, s) * size;
            std::copy(from + begin, from + end, row.begin() + static_cast<std::ptrdiff_t>(begin));
          }
          fitter.Evaluate(row, means);
          double product = 0, square = 0;
          for (size_t k = 0; k < samples; ++k) {
            product += static_cast<double>(weights.squares[k]) * own[k] * means[k];
            square += static_cast<double>(weights.squares[k]) * means[k] * means[k];
          }
          const double scale = square > 0 ? scales[i] * product / square : 0;
          factors.scales[i * stages] = static_cast<float>(
              std::clamp(scale, static_cast<double>(kLeastScale), static_cast<double>(kMostScale)));
        }
        return OkStatus();
      });
}

}  // namespace

StatusOr<ChainFactors> ClusterTables(const ChainFitter& fitter, const ChainWeights& given, int clusters,
                                     Quantisation quantisation, float floor,
                                     std::vector<float> values) {
  const std::vector<Stage>& stages = fitter.stages();
  const Layout& layout = fitter.layout();
  const size_t texels = values.size() / layout.size;
  const auto most = static_cast<int>(std::min(kMaxClusters, texels));
  if (clusters < 1 || clusters > most) {
    return InvalidArgument("{} clusters, permitted are 1 to {}", clusters, most);
  }
  // Scales of texels, all stages together, and what texels weigh.
  std::vector<float> scales(texels, 1.0f);
  double mean = 0;
  for (size_t i = 0; i < texels; ++i) {
    for (size_t s = 0; s < stages.size(); ++s) {
      scales[i] *= NormaliseStage(stages[s], layout.stages[s], values.data() + i * layout.size);
    }
    mean += scales[i] * given.Texel(i) / static_cast<double>(texels);
  }
  std::vector<float> weights(texels, 1.0f);
  for (size_t i = 0; i < texels && mean > 0; ++i) {
    weights[i] = std::max(static_cast<float>(scales[i] * given.Texel(i) / mean), kLeastWeight);
  }
  ChainFactors factors{stages, quantisation, floor, {}, std::vector<float>(texels * stages.size(), 1.0f),
                       std::vector<uint16_t>(texels * stages.size())};
  std::vector<double> means(static_cast<size_t>(clusters) * layout.size, 0.0);
  for (size_t s = 0; s < stages.size(); ++s) {
    algebra::LocalPcaOptions k_means;
    k_means.clusters = clusters;
    k_means.terms = 0;
    algebra::SvdOptions coordinates;
    coordinates.rank = kCoordinates;
    coordinates.max_power_steps = 1;
    MESORIG_ASSIGN_OR_RETURN(
        const algebra::LocalPcaResult result,
        algebra::ClusterRows(StageRows(stages[s], layout.stages[s], layout.size, given, values, weights),
                             weights, coordinates, k_means));
    for (size_t i = 0; i < texels; ++i) {
      factors.clusters[i * stages.size() + s] = static_cast<uint16_t>(result.cluster[i]);
    }
    AddMeans(stages[s], layout.stages[s], layout.size, values, weights, result.cluster, means);
  }
  factors.values.assign(means.begin(), means.end());
  MESORIG_RETURN_IF_ERROR(FitScales(fitter, given, values, scales, factors));
  BalanceRows(layout, factors);
  return factors;
}

}  // namespace mesorig::codecs::per_texel
