#pragma once
// Internal to the truncated decomposition: a matrix that is read in blocks of rows, by several workers.

#include <algorithm>
#include <functional>
#include <memory>
#include <vector>

#include "processing/codecs/algebra/truncated_svd.h"

namespace mesorig::codecs::algebra {

// Beyond these, squares leave float's range.
inline constexpr float kTooLarge = 1e15f, kTooSmall = 1e-15f;

// What one reading of the matrix tells.
struct Reading {
  double square = 0;    // ||A||^2
  float largest = 0;
};

// The blocks of a source, checked and multiplied by a power of two.
class Blocks {
 public:
  // Blocks of `at_least` rows (of 64, where that is more) where block_bytes allow fewer.
  Blocks(const RowSource& source, const SvdOptions& options, int64_t at_least);

  // Calls function(worker, first row, block) for all blocks; see ForParts.
  Status ForEach(const std::function<Status(int, int64_t, ViewF)>& function);
  int workers() const { return workers_; }

  // Adds up the norm and looks for what is not finite: InvalidArgument with its row and column.
  static Status Look(int64_t first, ViewF block, Reading& reading);

  void set_scale(float scale) { scale_ = scale; }
  float scale() const { return scale_; }

 private:
  ViewF Scaled(ViewF block, std::vector<float>& scaled) const;

  const RowSource& source_;
  int64_t rows_;
  int workers_;
  float scale_ = 1;
  std::vector<std::unique_ptr<float[]>> scratch_;  // of each worker
  std::vector<std::vector<float>> scaled_;
};

// One matrix of zeros a worker, added up in the end.
template <typename T>
class Sums {
 public:
  Sums(int workers, int64_t rows, int64_t cols)
      : parts_(static_cast<size_t>(workers), Matrix<T>(rows, cols)) {}
  Matrix<T>& of(int worker) { return parts_[static_cast<size_t>(worker)]; }
  Matrix<T> Total() {
    for (size_t w = 1; w < parts_.size(); ++w) {
      std::transform(parts_[w].values.begin(), parts_[w].values.end(), parts_[0].values.begin(),
                     parts_[0].values.begin(), std::plus<T>());
    }
    return std::move(parts_[0]);
  }

 private:
  std::vector<Matrix<T>> parts_;
};

// A small or turned matrix, whole.
StatusOr<MatrixF> Whole(const RowSource& source, Reading& reading);

// In float.
template <typename T>
MatrixF FirstColumns(const Matrix<T>& m, int64_t count) {
  MatrixF out(m.rows, count);
  std::transform(m.values.begin(), m.values.begin() + m.rows * count, out.values.begin(),
                 [](T x) { return static_cast<float>(x); });
  return out;
}

}  // namespace mesorig::codecs::algebra
