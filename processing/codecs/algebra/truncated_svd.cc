#include "processing/codecs/algebra/truncated_svd.h"

#include <algorithm>
#include <cmath>

#include "processing/codecs/algebra/svd_sketch.h"

namespace mesorig::codecs::algebra {
namespace {

constexpr double kDirectFlops = 2e7;     // min^2 * max: milliseconds
constexpr int64_t kGramAlways = 512;     // cheaper than anything else, whatever the rank
constexpr int64_t kGramSide = 2048;      // eigenvectors of more take seconds
constexpr int64_t kGramPerTerm = 6;      // a Gram matrix costs what six vectors a term cost
constexpr int64_t kTurnedBytes = int64_t{128} << 20;  // a matrix that is turned is held whole

StatusOr<TruncatedSvd> Direct(const RowSource& source, int64_t rank) {
  Reading reading;
  MESORIG_ASSIGN_OR_RETURN(const MatrixF all, Whole(source, reading));
  MatrixD wide(all.rows, all.cols);
  std::copy(all.values.begin(), all.values.end(), wide.values.begin());
  MESORIG_ASSIGN_OR_RETURN(Svd svd, ThinSvd(std::move(wide)));
  TruncatedSvd result;
  result.u = FirstColumns(svd.u, rank);
  result.v = FirstColumns(svd.v, rank);
  double rest = 0;
  for (size_t k = static_cast<size_t>(rank); k < svd.sigma.size(); ++k) {
    rest += svd.sigma[k] * svd.sigma[k];
  }
  svd.sigma.resize(static_cast<size_t>(rank));
  result.sigma = std::move(svd.sigma);
  result.norm = std::sqrt(reading.square);
  result.residual = result.norm > 0 ? std::sqrt(rest) / result.norm : 0;
  result.method = SvdMethod::kDirect;
  return result;
}

// The same matrix with rows for columns, held whole.
StatusOr<MatrixF> Turned(const RowSource& source) {
  Reading reading;
  MESORIG_ASSIGN_OR_RETURN(const MatrixF all, Whole(source, reading));
  MatrixF turned(all.cols, all.rows);
  for (int64_t j = 0; j < all.cols; ++j) {
    for (int64_t i = 0; i < all.rows; ++i) turned(j, i) = all(i, j);
  }
  return turned;
}

SvdMethod Choose(const RowSource& source, const SvdOptions& options, int64_t rank) {
  if (options.method != SvdMethod::kAutomatic) return options.method;
  const int64_t small = std::min(source.rows(), source.cols());
  const auto a = static_cast<double>(small), b = static_cast<double>(source.rows() + source.cols());
  if (a * a * b <= kDirectFlops) return SvdMethod::kDirect;
  const bool turned = source.rows() < source.cols();
  const bool fits = !turned || 4 * source.rows() * source.cols() <= kTurnedBytes;
  const int64_t worth = std::max(kGramAlways, kGramPerTerm * (rank + options.oversampling));
  if (small <= std::min(kGramSide, worth) && fits) {
    return SvdMethod::kGram;
  }
  return SvdMethod::kRandomised;
}

}  // namespace

StatusOr<TruncatedSvd> DecomposeTruncated(const RowSource& source, const SvdOptions& options) {
  if (source.rows() < 1 || source.cols() < 1) {
    return InvalidArgument("a matrix of {} x {}: both must be at least 1", source.rows(),
                           source.cols());
  }
  if (options.rank < 1) return InvalidArgument("rank {}, at least 1 is permitted", options.rank);
  const int64_t rank = std::min({options.rank, source.rows(), source.cols()});
  switch (Choose(source, options, rank)) {
    case SvdMethod::kDirect:
      return Direct(source, rank);
    case SvdMethod::kGram: {
      if (source.rows() >= source.cols()) return Sketch(source, options, rank).Gram();
      MESORIG_ASSIGN_OR_RETURN(const MatrixF turned, Turned(source));
      MESORIG_ASSIGN_OR_RETURN(TruncatedSvd result,
                               Sketch(DenseSource(turned), options, rank).Gram());
      std::swap(result.u, result.v);
      return result;
    }
    default:
      return Sketch(source, options, rank).Randomised();
  }
}

}  // namespace mesorig::codecs::algebra
