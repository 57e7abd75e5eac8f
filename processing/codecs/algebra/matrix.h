#pragma once
// Dense column-major matrices and what BLAS and LAPACK do with them. Sizes must match (our own bugs
// are checked); nothing here is NaN-safe: callers refuse values that are not finite. Reentrant; the
// products of large matrices use the threads of threads.h.

#include <cstdint>
#include <vector>

#include "processing/codecs/algebra/threads.h"
#include "protocol/base/status.h"

namespace mesorig::codecs::algebra {

template <typename T>
struct Matrix {
  int64_t rows = 0, cols = 0;
  std::vector<T> values;  // element (i, j) at j * rows + i

  Matrix() = default;
  Matrix(int64_t r, int64_t c)
      : rows(r), cols(c), values(static_cast<size_t>(r) * static_cast<size_t>(c), T(0)) {}
  T& operator()(int64_t i, int64_t j) { return values[static_cast<size_t>(j * rows + i)]; }
  T operator()(int64_t i, int64_t j) const { return values[static_cast<size_t>(j * rows + i)]; }
  T* Column(int64_t j) { return values.data() + j * rows; }
  const T* Column(int64_t j) const { return values.data() + j * rows; }
};
using MatrixF = Matrix<float>;
using MatrixD = Matrix<double>;

// Borrowed: element (i, j) at j * stride + i.
template <typename T>
struct View {
  const T* data = nullptr;
  int64_t rows = 0, cols = 0, stride = 0;

  View() = default;
  View(const T* d, int64_t r, int64_t c, int64_t s) : data(d), rows(r), cols(c), stride(s) {}
  View(const Matrix<T>& m) : data(m.values.data()), rows(m.rows), cols(m.cols), stride(m.rows) {}
};
using ViewF = View<float>;
using ViewD = View<double>;

// op(a) op(b), op is the transpose where asked for.
MatrixF Multiply(ViewF a, bool transpose_a, ViewF b, bool transpose_b);
MatrixD Multiply(ViewD a, bool transpose_a, ViewD b, bool transpose_b);
// c = op(a) op(b) + beta c, where c's first element and stride are given.
void MultiplyInto(ViewF a, bool transpose_a, ViewF b, bool transpose_b, float beta, float* c,
                  int64_t stride_c);

// gram += a^T a in double, both triangles. a.cols x a.cols.
void AddGram(ViewF a, MatrixD& gram);

// c += a^T b in double. a.cols x b.cols.
void AddProduct(ViewF a, ViewF b, MatrixD& c);

// Columns to an orthonormal basis that holds their span, whatever their rank (Householder; columns
// that depend on others become arbitrary ones orthogonal to all). rows >= cols. With `r` also the
// triangular factor: a = q r.
Status Orthonormalise(MatrixF& a, MatrixF* r = nullptr);

// Eigenvalues in falling order, eigenvectors in the columns of `a`, which must be symmetric.
Status SymmetricEigen(MatrixD& a, std::vector<double>& values);

// a = u diag(sigma) v^T with min(rows, cols) columns, sigma falling.
struct Svd {
  MatrixD u, v;
  std::vector<double> sigma;
};
StatusOr<Svd> ThinSvd(MatrixD a);

// x of the symmetric positive definite normal equations a x = b, each column of b; a's diagonal is
// raised by `ridge` times its mean, and by 1 where it is all zero. Cholesky.
Status SolvePositive(MatrixD a, double ridge, MatrixD& b);

// The largest |(a^T a - 1)_ij|, in double.
double OrthogonalityError(ViewF a);

}  // namespace mesorig::codecs::algebra
