#pragma once
// The leading singular triplets of a matrix that is never held whole: A ~ U diag(sigma) V^T.
//
// Three ways, chosen by size (SvdOptions::method asks for one):
// - direct: LAPACK's full decomposition in double, for small matrices;
// - Gram: eigenvectors of the Gram matrix of the shorter side, in double, where that side is short
//   beside the rank. Where the spectrum falls by more than what squaring leaves visible (1e-5), the
//   basis is re-orthogonalised in power steps;
// - randomised (Halko, Martinsson and Tropp 2011, Alg. 4.4; Musco and Musco 2015): a sketch (of a large
//   matrix by signed sums of its rows, Clarkson and Woodruff 2013, else Gaussian), then power steps,
//   each one reading of the matrix, until the residual stands still. The basis keeps what earlier steps
//   found (block Krylov: fewer readings for the same error) while it takes less than 256 MB; beyond,
//   Q <- orth(A^T (A Q)).
// All end with B = A Q, its QR and the decomposition of the small triangle: U and V are orthonormal
// to rounding at any condition number.

#include <cstdint>
#include <vector>

#include "processing/codecs/algebra/matrix.h"

namespace mesorig::codecs::algebra {

// A rows x cols matrix, given in blocks of rows. Read several times, by several threads at once.
class RowSource {
 public:
  virtual ~RowSource() = default;
  virtual int64_t rows() const = 0;
  virtual int64_t cols() const = 0;
  // Rows are best asked for from multiples of this on, by multiples.
  virtual int64_t granule() const { return 1; }
  // Rows [first, first + count), as a view of the source's own memory or of `scratch`, which has
  // room for count * cols values and is the caller's alone. Valid until the next call with that scratch.
  virtual StatusOr<ViewF> Rows(int64_t first, int64_t count, float* scratch) const = 0;
};

// A matrix in memory, borrowed.
class DenseSource final : public RowSource {
 public:
  explicit DenseSource(ViewF matrix) : matrix_(matrix) {}
  int64_t rows() const override { return matrix_.rows; }
  int64_t cols() const override { return matrix_.cols; }
  StatusOr<ViewF> Rows(int64_t first, int64_t count, float*) const override {
    return ViewF(matrix_.data + first, count, matrix_.cols, matrix_.stride);
  }

 private:
  ViewF matrix_;
};

enum class SvdMethod { kAutomatic, kDirect, kGram, kRandomised };

struct SvdOptions {
  int64_t rank = 8;           // at most min(rows, cols) are returned
  int64_t oversampling = 16;
  int max_power_steps = 8;
  // Power steps end when another one would lower the residual of `rank` terms by less than this
  // fraction; never below 0.
  double stop = 0.003;
  uint64_t seed = 1;
  int64_t block_bytes = int64_t{64} << 20;  // memory beside the factors: about a block a thread
  SvdMethod method = SvdMethod::kAutomatic;
};

struct TruncatedSvd {
  MatrixF u, v;               // rows x rank, cols x rank, orthonormal columns
  std::vector<double> sigma;  // falling, not negative
  double norm = 0;            // ||A||_F, in double
  // ||A - U sigma V^T||_F / ||A||_F from the energies; resolved to about 5e-4. 0 for a zero matrix.
  double residual = 0;
  int power_steps = 0;
  SvdMethod method = SvdMethod::kAutomatic;  // the way it went
};

// InvalidArgument for an empty matrix, a rank below 1, and NaN or infinity, with row and column.
// Equal seeds and thread counts give equal bits; other thread counts agree to rounding.
StatusOr<TruncatedSvd> DecomposeTruncated(const RowSource& source, const SvdOptions& options);

}  // namespace mesorig::codecs::algebra
