#include "processing/codecs/linear/abrdf_matrix.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace mesorig::codecs {

AbrdfMatrix::AbrdfMatrix(const btf::SampledBtf& btf, const SampleWeights& weights,
                         Weighting weighting, int view)
    : btf_(btf), weights_(weights), log_(weighting == Weighting::kLog),
      texels_(btf.header().texel_count()) {
  std::iota(texels_.begin(), texels_.end(), size_t{0});
  const int first = view < 0 ? 0 : view, last = view < 0 ? btf.header().view_count() : view + 1;
  for (int v = first; v < last; ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      if (btf.Present(v, l)) pairs_.push_back(btf.PairIndex(v, l));
    }
  }
}

StatusOr<algebra::ViewF> AbrdfMatrix::Rows(int64_t first, int64_t count, float* scratch) const {
  const auto n = static_cast<size_t>(count);
  const size_t* const texels = texels_.data() + first;
  const bool contiguous = texels[n - 1] - texels[0] == n - 1;
  const auto lights = btf_.header().lights.size();
  const auto floor = static_cast<float>(weights_.floor);
  for (size_t p = 0; p < pairs_.size(); ++p) {
    const float* const image =
        btf_.Image(static_cast<int>(pairs_[p] / lights), static_cast<int>(pairs_[p] % lights))
            .data();
    for (size_t c = 0; c < 3; ++c) {
      float* const out = scratch + (3 * p + c) * n;
      const float weight = weights_.sample[3 * pairs_[p] + c];
      const float mean = mean_.empty() ? 0.0f : mean_[3 * p + c];
      if (contiguous) {
        const float* const from = image + 3 * texels[0] + c;
        for (size_t i = 0; i < n; ++i) out[i] = from[3 * i];
      } else {
        for (size_t i = 0; i < n; ++i) out[i] = image[3 * texels[i] + c];
      }
      if (log_) {
        for (size_t i = 0; i < n; ++i) out[i] = std::log(std::max(out[i], 0.0f) + floor);
      }
      for (size_t i = 0; i < n; ++i) {
        out[i] = (out[i] * weight - mean) * weights_.texel[texels[i]];
      }
    }
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
