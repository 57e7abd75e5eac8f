#pragma once
// Internal to the truncated decomposition: the work on a large matrix (truncated_svd.h says how).

#include <functional>

#include "processing/codecs/algebra/svd_blocks.h"

namespace mesorig::codecs::algebra {

// In the units of Blocks::scale(). Borrows what it is given. Once: Randomised() or Gram().
class Sketch {
 public:
  Sketch(const RowSource& source, const SvdOptions& options, int64_t rank)
      : source_(source), options_(options), rank_(rank),
        width_(std::min({rank + std::max<int64_t>(options.oversampling, 0), source.rows(),
                         source.cols()})),
        blocks_(source, options, width_) {}

  StatusOr<TruncatedSvd> Randomised();
  StatusOr<TruncatedSvd> Gram();

 private:
  // svd_first_basis.cc.
  // The first basis. Again, scaled, where squares would leave float's range.
  Status Start(const std::function<Status()>& basis);
  // Numbers of a row's own, whatever the blocks (splitmix64).
  uint64_t Draw(int64_t row) const;
  // The first basis of the randomised way: of S A where S, whose rows are far fewer than A's but far
  // more than the vectors looked for, costs no more than reading A; else of G A, G Gaussian.
  Status First();
  // S adds each row of A, with a random sign, to one of `rows` sums (Clarkson and Woodruff 2013): a
  // matrix whose leading right singular vectors are nearly those of A.
  Status CountSketch(int64_t rows);
  // Q = orth(A^T G), G Gaussian: each row of it from a generator of its own.
  Status Gaussian();
  // Q = the leading eigenvectors of A^T A.
  Status Eigenvectors(bool& visible);
  // Looks at each block before it calls function(worker, first, block); reading_ is what was seen.
  Status ForEachSeen(const std::function<void(int, int64_t, ViewF)>& function);
  bool InRange() const { return reading_.largest <= kTooLarge; }

  // svd_power_steps.cc.
  // How many blocks of width_ vectors the basis may grow to.
  int64_t MostBlocks(int steps) const;
  // Q <- orth([Q, A^T (A q)]), q what was added last (block Lanczos): a step costs no more reading and
  // no more products with A than one of Q <- orth(A^T (A Q)), to which it falls back where the basis
  // would become too large, and its span holds what all of those have found.
  Status PowerSteps(int steps);
  // The part of residual^2 that the newest vectors' images `next` = A^T A q are about to explain, to
  // first order: for each of the leading Ritz pairs |A^T A x - lambda x|^2 / (lambda - mu), mu the
  // smallest Ritz value; of Krylov spaces only the newest block's images leave their span.
  StatusOr<double> Gain(const MatrixF& next);
  // Q <- orth(A^T (A Q)); on the way the energy that `rank` terms of the old Q capture.
  Status PlainPowerSteps(int steps);
  // The columns of the basis whose products are not in b_ yet.
  ViewF Newest() const {
    return {q_.Column(b_.cols), q_.rows, q_.cols - b_.cols, q_.rows};
  }
  // z = A q, and next = A^T z where it is asked for.
  Status MultiplyNewest(MatrixF& z, MatrixF* next);
  // Appends z to b_, and the products with it to gram_ = b_^T b_.
  void AddProducts(const MatrixF& z);
  // Appends to the basis an orthonormal basis of what `next` adds to its span. Gram and Schmidt twice;
  // where little is left of `next` that is not enough, and all of it is done by reflections.
  Status Extend(MatrixF next);
  // Orthonormal columns that stand where nearly orthonormal ones stood.
  static Status Straighten(MatrixF& q);
  // B = A Q; W the leading eigenvectors of B^T B; B W = U' R, R = U'' sigma V''^T; U = U' U'',
  // V = Q W V''.
  StatusOr<TruncatedSvd> Finish(SvdMethod method);

  const RowSource& source_;
  const SvdOptions& options_;
  int64_t rank_, width_;
  Blocks blocks_;
  Reading reading_;
  MatrixF q_;     // the basis, orthonormal columns
  MatrixF b_;     // A times its first columns
  MatrixD gram_;  // b_^T b_
  int power_steps_ = 0;
};

}  // namespace mesorig::codecs::algebra
