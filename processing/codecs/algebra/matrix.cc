#include "processing/codecs/algebra/matrix.h"

#include <cblas.h>
#include <lapacke.h>

#include <algorithm>
#include <cmath>

#include "protocol/base/check.h"

namespace mesorig::codecs::algebra {
namespace {

// Every size that BLAS and LAPACK are told goes through here: threads.h.
blasint Int(int64_t n) {
  static const bool one_thread = (openblas_set_num_threads(1), true);
  (void)one_thread;
  MESORIG_CHECK(n >= 0 && n < (int64_t{1} << 31));
  return static_cast<blasint>(n);
}

// BLAS asks for strides of at least 1.
blasint Stride(int64_t n) { return Int(std::max<int64_t>(n, 1)); }

CBLAS_TRANSPOSE Op(bool transpose) { return transpose ? CblasTrans : CblasNoTrans; }

template <typename T>
struct Sizes {
  int64_t m, n, k;
  Sizes(View<T> a, bool transpose_a, View<T> b, bool transpose_b)
      : m(transpose_a ? a.cols : a.rows), n(transpose_b ? b.rows : b.cols),
        k(transpose_a ? a.rows : a.cols) {
    MESORIG_CHECK(k == (transpose_b ? b.cols : b.rows));
  }
};

constexpr int64_t kWorthThreads = int64_t{1} << 26;  // multiplications
constexpr int64_t kGramRows = 4096;  // converted at a time

}  // namespace

void MultiplyInto(ViewF a, bool transpose_a, ViewF b, bool transpose_b, float beta, float* c,
                  int64_t stride_c) {
  const Sizes<float> s(a, transpose_a, b, transpose_b);
  if (s.m == 0 || s.n == 0) return;
  const int64_t workers = s.m * s.n * s.k >= kWorthThreads ? Threads() : 1;
  const Status status = ForParts(
      static_cast<int>(workers), s.m, (s.m + workers - 1) / workers,
      [&](int, int64_t first, int64_t rows) {
        const float* const from = a.data + (transpose_a ? first * a.stride : first);
        cblas_sgemm(CblasColMajor, Op(transpose_a), Op(transpose_b), Int(rows), Int(s.n), Int(s.k),
                    1.0f, from, Stride(a.stride), b.data, Stride(b.stride), beta, c + first,
                    Stride(stride_c));
        return OkStatus();
      });
  MESORIG_CHECK(status.ok());
}

MatrixF Multiply(ViewF a, bool transpose_a, ViewF b, bool transpose_b) {
  const Sizes<float> s(a, transpose_a, b, transpose_b);
  MatrixF c(s.m, s.n);
  MultiplyInto(a, transpose_a, b, transpose_b, 0.0f, c.values.data(), c.rows);
  return c;
}

MatrixD Multiply(ViewD a, bool transpose_a, ViewD b, bool transpose_b) {
  const Sizes<double> s(a, transpose_a, b, transpose_b);
  MatrixD c(s.m, s.n);
  if (s.m == 0 || s.n == 0) return c;
  cblas_dgemm(CblasColMajor, Op(transpose_a), Op(transpose_b), Int(s.m), Int(s.n), Int(s.k), 1.0,
              a.data, Stride(a.stride), b.data, Stride(b.stride), 0.0, c.values.data(),
              Stride(c.rows));
  return c;
}

namespace {

// Rows [first, first + rows) in double.
MatrixD Wide(ViewF a, int64_t first, int64_t rows) {
  MatrixD wide(rows, a.cols);
  for (int64_t j = 0; j < a.cols; ++j) {
    const float* const from = a.data + j * a.stride + first;
    std::copy(from, from + rows, wide.Column(j));
  }
  return wide;
}

}  // namespace

void AddProduct(ViewF a, ViewF b, MatrixD& c) {
  MESORIG_CHECK(a.rows == b.rows && c.rows == a.cols && c.cols == b.cols);
  if (a.cols == 0 || b.cols == 0) return;
  for (int64_t first = 0; first < a.rows; first += kGramRows) {
    const int64_t rows = std::min(kGramRows, a.rows - first);
    const MatrixD x = Wide(a, first, rows), y = Wide(b, first, rows);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, Int(a.cols), Int(b.cols), Int(rows), 1.0,
                x.values.data(), Stride(rows), y.values.data(), Stride(rows), 1.0, c.values.data(),
                Stride(c.rows));
  }
}

void AddGram(ViewF a, MatrixD& gram) {
  MESORIG_CHECK(gram.rows == a.cols && gram.cols == a.cols);
  if (a.cols == 0) return;
  for (int64_t first = 0; first < a.rows; first += kGramRows) {
    const int64_t rows = std::min(kGramRows, a.rows - first);
    const MatrixD block = Wide(a, first, rows);
    cblas_dsyrk(CblasColMajor, CblasLower, CblasTrans, Int(a.cols), Int(rows), 1.0,
                block.values.data(), Stride(rows), 1.0, gram.values.data(), Stride(gram.rows));
  }
  for (int64_t j = 0; j < gram.cols; ++j) {
    for (int64_t i = 0; i < j; ++i) gram(i, j) = gram(j, i);
  }
}

Status Orthonormalise(MatrixF& a, MatrixF* r) {
  MESORIG_CHECK(a.rows >= a.cols);
  if (r != nullptr) *r = MatrixF(a.cols, a.cols);
  if (a.cols == 0) return OkStatus();
  std::vector<float> tau(static_cast<size_t>(a.cols));
  int info = LAPACKE_sgeqrf(LAPACK_COL_MAJOR, Int(a.rows), Int(a.cols), a.values.data(),
                            Stride(a.rows), tau.data());
  if (info != 0) return Internal("QR of {} x {}: LAPACK says {}", a.rows, a.cols, info);
  for (int64_t j = 0; r != nullptr && j < a.cols; ++j) {
    for (int64_t i = 0; i <= j; ++i) (*r)(i, j) = a(i, j);
  }
  info = LAPACKE_sorgqr(LAPACK_COL_MAJOR, Int(a.rows), Int(a.cols), Int(a.cols), a.values.data(),
                        Stride(a.rows), tau.data());
  if (info != 0) return Internal("QR of {} x {}: LAPACK says {}", a.rows, a.cols, info);
  return OkStatus();
}

Status SymmetricEigen(MatrixD& a, std::vector<double>& values) {
  MESORIG_CHECK(a.rows == a.cols);
  values.assign(static_cast<size_t>(a.cols), 0.0);
  if (a.cols == 0) return OkStatus();
  const int info = LAPACKE_dsyevd(LAPACK_COL_MAJOR, 'V', 'L', Int(a.rows), a.values.data(),
                                  Stride(a.rows), values.data());
  if (info != 0) return Internal("eigenvalues of {} x {}: LAPACK says {}", a.rows, a.cols, info);
  std::reverse(values.begin(), values.end());
  for (int64_t j = 0; j < a.cols / 2; ++j) {
    std::swap_ranges(a.Column(j), a.Column(j) + a.rows, a.Column(a.cols - 1 - j));
  }
  return OkStatus();
}

StatusOr<Svd> ThinSvd(MatrixD a) {
  const int64_t k = std::min(a.rows, a.cols);
  Svd svd{MatrixD(a.rows, k), MatrixD(a.cols, k), std::vector<double>(static_cast<size_t>(k))};
  if (k == 0) return svd;
  MatrixD vt(k, a.cols);
  const int info = LAPACKE_dgesdd(LAPACK_COL_MAJOR, 'S', Int(a.rows), Int(a.cols), a.values.data(),
                                  Stride(a.rows), svd.sigma.data(), svd.u.values.data(),
                                  Stride(a.rows), vt.values.data(), Stride(k));
  if (info != 0) return Internal("SVD of {} x {}: LAPACK says {}", a.rows, a.cols, info);
  for (int64_t j = 0; j < a.cols; ++j) {
    for (int64_t i = 0; i < k; ++i) svd.v(j, i) = vt(i, j);
  }
  return svd;
}

Status SolvePositive(MatrixD a, double ridge, MatrixD& b) {
  MESORIG_CHECK(a.rows == a.cols && b.rows == a.rows);
  if (a.rows == 0 || b.cols == 0) return OkStatus();
  double mean = 0;
  for (int64_t i = 0; i < a.rows; ++i) mean += a(i, i) / static_cast<double>(a.rows);
  for (int64_t i = 0; i < a.rows; ++i) a(i, i) += mean > 0 ? ridge * mean : 1.0;
  const int info = LAPACKE_dposv(LAPACK_COL_MAJOR, 'L', Int(a.rows), Int(b.cols), a.values.data(),
                                 Stride(a.rows), b.values.data(), Stride(b.rows));
  if (info != 0) return Internal("normal equations of {} unknowns: LAPACK says {}", a.rows, info);
  return OkStatus();
}

double OrthogonalityError(ViewF a) {
  MatrixD gram(a.cols, a.cols);
  AddGram(a, gram);
  double worst = 0;
  for (int64_t j = 0; j < a.cols; ++j) {
    for (int64_t i = 0; i < a.cols; ++i) {
      worst = std::max(worst, std::abs(gram(i, j) - (i == j ? 1.0 : 0.0)));
    }
  }
  return worst;
}

}  // namespace mesorig::codecs::algebra
