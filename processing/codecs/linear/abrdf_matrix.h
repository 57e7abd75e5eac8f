#pragma once
// A BTF as the matrix that linear bases factorise: a row a texel (its apparent BRDF), a column a
// channel of a present pair. Never held whole: blocks of rows are gathered from the images.

#include <vector>

#include "processing/codecs/algebra/truncated_svd.h"
#include "processing/codecs/linear/sample_source.h"
#include "processing/codecs/linear/sample_weights.h"

namespace mesorig::codecs {

class AbrdfMatrix final : public algebra::RowSource {
 public:
  // Borrows what it is given. All present pairs, or those of one view. At least one is needed.
  AbrdfMatrix(const SampleSource& source, const SampleWeights& weights, Weighting weighting,
              int view = -1);

  int64_t rows() const override { return static_cast<int64_t>(texels_.size()); }
  int64_t cols() const override { return 3 * static_cast<int64_t>(pairs_.size()); }
  int64_t granule() const override { return selected_ ? 1 : source_->granule(); }
  // Values, or log(max(value, 0) + floor), less the mean where one is set, times the weights.
  StatusOr<algebra::ViewF> Rows(int64_t first, int64_t count, float* scratch) const override;

  // Only these texels, ascending, from now on.
  void Select(std::vector<size_t> texels) { texels_ = std::move(texels), selected_ = true; }
  // Subtracted from every row before the texel's weight; in the weighted columns' unit.
  void SetMean(std::vector<float> mean) { mean_ = std::move(mean); }
  // The mean row that is best under the weights, each row counting by its texel weight squared.
  StatusOr<std::vector<float>> MeanRow(int64_t block_bytes) const;

  // Pair indices v * nL + l, of columns 3 i to 3 i + 2.
  const std::vector<size_t>& pairs() const { return pairs_; }
  const std::vector<size_t>& texels() const { return texels_; }
  float TexelWeight(int64_t row) const { return weights_.texel[texels_[static_cast<size_t>(row)]]; }
  float ColumnWeight(int64_t column) const {
    return weights_.sample[3 * pairs_[static_cast<size_t>(column) / 3] +
                           static_cast<size_t>(column) % 3];
  }

 private:
  const SampleSource* source_;
  const SampleWeights& weights_;
  bool log_, selected_ = false;
  std::vector<size_t> pairs_, texels_;
  std::vector<float> mean_;
};

}  // namespace mesorig::codecs
