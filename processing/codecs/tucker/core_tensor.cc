#include "processing/codecs/tucker/core_tensor.h"

#include <algorithm>
#include <cmath>

namespace mesorig::codecs::tucker {
namespace {

using algebra::MatrixD;
using algebra::MatrixF;
using algebra::ViewF;

constexpr int kSweeps = 3, kMaxFills = 60;
constexpr double kStop = 1e-4;  // fills end when one lowers the error by less than this fraction

// Slice a as BLAS sees it: column-major rows x views.
ViewF SliceView(const Tensor& t, int64_t a) { return {t.Slice(a), t.rows, t.views, t.rows}; }

MatrixF FirstColumns(const MatrixD& m, int64_t count) {
  MatrixF out(m.rows, count);
  std::transform(m.values.begin(), m.values.begin() + m.rows * count, out.values.begin(),
                 [](double x) { return static_cast<float>(x); });
  return out;
}

// The fewest leading values that leave at most `budget` behind; all for 0.
int64_t Enough(const std::vector<double>& values, double budget) {
  auto count = static_cast<int64_t>(values.size());
  if (budget <= 0) return count;
  double left = 0;
  while (count > 1) {
    left += std::max(values[static_cast<size_t>(count - 1)], 0.0);
    if (left > budget) break;
    --count;
  }
  return count;
}

// The columns of `other` times slice a; the slice as it is where there is none. Its columns are the
// mode that is looked for.
MatrixF Projected(const Tensor& t, int64_t a, bool of_views, const MatrixF* other) {
  if (other != nullptr) return algebra::Multiply(*other, true, SliceView(t, a), !of_views);
  if (of_views) {
    MatrixF slice(t.rows, t.views);
    std::copy_n(t.Slice(a), slice.values.size(), slice.values.begin());
    return slice;
  }
  MatrixF turned(t.views, t.rows);
  for (int64_t v = 0; v < t.views; ++v) {
    for (int64_t r = 0; r < t.rows; ++r) turned(v, r) = t.Slice(a)[v * t.rows + r];
  }
  return turned;
}

// The leading eigenvectors of the Gram matrix of a mode: views, or rows. `count` 0: as many as the
// budget asks for.
StatusOr<MatrixF> Leading(const Tensor& t, bool of_views, const MatrixF* other, int64_t count,
                          double budget) {
  const int64_t side = of_views ? t.views : t.rows;
  MatrixD gram(side, side);
  for (int64_t a = 0; a < t.terms; ++a) algebra::AddGram(Projected(t, a, of_views, other), gram);
  std::vector<double> values;
  MESORIG_RETURN_IF_ERROR(algebra::SymmetricEigen(gram, values));
  return FirstColumns(gram, count > 0 ? count : Enough(values, budget));
}

// Alternates between the modes (HOOI), numbers of terms fixed.
Status Sweep(const Tensor& t, Modes& m) {
  const int64_t view_terms = m.views.cols, row_terms = m.rows.cols;
  MESORIG_ASSIGN_OR_RETURN(m.rows, Leading(t, false, &m.views, row_terms, 0));
  MESORIG_ASSIGN_OR_RETURN(m.views, Leading(t, true, &m.rows, view_terms, 0));
  ++m.rounds;
  return OkStatus();
}

// R^T S V: row terms x view terms, one a slice.
MatrixF CoreSlice(const Tensor& t, int64_t a, const Modes& m) {
  return algebra::Multiply(algebra::Multiply(m.rows, true, SliceView(t, a), false), false, m.views,
                           false);
}

// What is absent becomes what its view and its row have on average, added.
void FillByMeans(Tensor& t) {
  for (int64_t a = 0; a < t.terms; ++a) {
    float* const slice = t.Slice(a);
    std::vector<double> of_view(static_cast<size_t>(t.views), 0.0), views = of_view;
    std::vector<double> of_row(static_cast<size_t>(t.rows), 0.0), rows = of_row;
    double all = 0, count = 0;
    for (int64_t v = 0; v < t.views; ++v) {
      for (int64_t r = 0; r < t.rows; ++r) {
        if (!t.Present(v, r)) continue;
        const double x = slice[v * t.rows + r];
        of_view[static_cast<size_t>(v)] += x, views[static_cast<size_t>(v)] += 1;
        of_row[static_cast<size_t>(r)] += x, rows[static_cast<size_t>(r)] += 1;
        all += x, count += 1;
      }
    }
    all /= std::max(count, 1.0);
    const auto mean = [all](double sum, double n) { return n > 0 ? sum / n : all; };
    for (int64_t v = 0; v < t.views; ++v) {
      for (int64_t r = 0; r < t.rows; ++r) {
        if (t.Present(v, r)) continue;
        slice[v * t.rows + r] = static_cast<float>(
            mean(of_view[static_cast<size_t>(v)], views[static_cast<size_t>(v)]) +
            mean(of_row[static_cast<size_t>(r)], rows[static_cast<size_t>(r)]) - all);
      }
    }
  }
}

// What is absent becomes what the factors say of it. Returns the squared error over what is present.
double Fill(const Modes& m, Tensor& t) {
  double error = 0;
  for (int64_t a = 0; a < t.terms; ++a) {
    const MatrixF said = algebra::Multiply(algebra::Multiply(m.rows, false, CoreSlice(t, a, m), false),
                                           false, m.views, true);
    float* const slice = t.Slice(a);
    for (int64_t v = 0; v < t.views; ++v) {
      for (int64_t r = 0; r < t.rows; ++r) {
        float& x = slice[v * t.rows + r];
        if (t.Present(v, r)) {
          error += std::pow(static_cast<double>(x) - said(r, v), 2);
        } else {
          x = said(r, v);
        }
      }
    }
  }
  return error;
}

}  // namespace

StatusOr<Modes> DecomposeModes(Tensor tensor, double budget) {
  const bool holes = std::count(tensor.present.begin(), tensor.present.end(), 0) > 0;
  if (holes) FillByMeans(tensor);
  Modes m;
  // With holes few terms first: what they fill in asks for no terms of its own.
  for (const double part : holes ? std::vector<double>{64, 8, 1, 1} : std::vector<double>{1}) {
    MESORIG_ASSIGN_OR_RETURN(m.views, Leading(tensor, true, nullptr, 0, part * budget));
    MESORIG_ASSIGN_OR_RETURN(m.rows, Leading(tensor, false, nullptr, 0, part * budget));
    double before = -1;
    for (int round = 0; round < (holes ? kMaxFills : kSweeps); ++round) {
      MESORIG_RETURN_IF_ERROR(Sweep(tensor, m));
      if (!holes) continue;
      const double now = Fill(m, tensor);
      if (before >= 0 && before - now <= kStop * before) break;
      before = now;
    }
  }
  for (int64_t a = 0; a < tensor.terms; ++a) {
    const MatrixF core = CoreSlice(tensor, a, m);
    m.core.insert(m.core.end(), core.values.begin(), core.values.end());
  }
  return m;
}

}  // namespace mesorig::codecs::tucker
