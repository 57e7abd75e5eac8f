#include "processing/codecs/linear/abrdf_matrix.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace mesorig::codecs {

AbrdfMatrix::AbrdfMatrix(const SampleSource& source, const SampleWeights& weights,
                         Weighting weighting, int view)
    : source_(&source), weights_(weights), log_(weighting == Weighting::kLog),
      pairs_(source.Pairs()), texels_(source.header().texel_count()) {
  std::iota(texels_.begin(), texels_.end(), size_t{0});
  const size_t lights = source.header().lights.size();
  if (view >= 0) {
    std::erase_if(pairs_, [&](size_t pair) { return pair / lights != static_cast<size_t>(view); });
  }
}

StatusOr<algebra::ViewF> AbrdfMatrix::Rows(int64_t first, int64_t count, float* scratch) const {
  const auto n = static_cast<size_t>(count);
  const size_t* const texels = texels_.data() + first;
  const bool run = !selected_ || texels[n - 1] - texels[0] == n - 1;
  MESORIG_RETURN_IF_ERROR(
      run ? source_->Columns(static_cast<int64_t>(texels[0]), count, pairs_, scratch)
          : source_->Gather(std::span(texels_).subspan(static_cast<size_t>(first), n), pairs_, scratch));
  const auto floor = static_cast<float>(weights_.floor);
  for (size_t j = 0; j < 3 * pairs_.size(); ++j) {
    float* const out = scratch + j * n;
    const float weight = ColumnWeight(static_cast<int64_t>(j));
    const float mean = mean_.empty() ? 0.0f : mean_[j];
    if (log_) {
      for (size_t i = 0; i < n; ++i) out[i] = std::log(std::max(out[i], 0.0f) + floor);
    }
    for (size_t i = 0; i < n; ++i) out[i] = (out[i] * weight - mean) * weights_.texel[texels[i]];
  }
  return algebra::ViewF(scratch, count, cols(), count);
}

StatusOr<std::vector<float>> AbrdfMatrix::MeanRow(int64_t block_bytes) const {
  const int64_t block = std::clamp<int64_t>(block_bytes / (4 * cols()), 1, rows());
  std::vector<float> scratch(static_cast<size_t>(block * cols()));
  std::vector<double> sums(static_cast<size_t>(cols()), 0.0);
  double total = 0;
  for (int64_t first = 0; first < rows(); first += block) {
    const int64_t count = std::min(block, rows() - first);
    MESORIG_ASSIGN_OR_RETURN(const algebra::ViewF view, Rows(first, count, scratch.data()));
    for (int64_t i = 0; i < count; ++i) total += std::pow(TexelWeight(first + i), 2);
    for (int64_t j = 0; j < view.cols; ++j) {
      double sum = 0;  // rows carry the weight once already
      for (int64_t i = 0; i < count; ++i) {
        sum += static_cast<double>(view.data[j * view.stride + i]) * TexelWeight(first + i);
      }
      sums[static_cast<size_t>(j)] += sum;
    }
  }
  std::vector<float> mean(sums.size());
  std::transform(sums.begin(), sums.end(), mean.begin(),
                 [total](double s) { return static_cast<float>(s / total); });
  return mean;
}

}  // namespace mesorig::codecs
