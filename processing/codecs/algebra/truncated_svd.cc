#include "processing/codecs/algebra/truncated_svd.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

namespace mesorig::codecs::algebra {
namespace {

constexpr double kDirectFlops = 2e7;     // min^2 * max: milliseconds
constexpr int64_t kGramAlways = 512;     // cheaper than anything else, whatever the rank
constexpr int64_t kGramSide = 2048;      // eigenvectors of more take seconds
constexpr int64_t kGramPerTerm = 6;      // a Gram matrix costs what six vectors a term cost
constexpr int64_t kTurnedBytes = int64_t{512} << 20;  // a matrix that is turned is held whole
constexpr double kGramVisible = 1e-10;   // of the first eigenvalue: 1e-5 of the singular value
constexpr float kTooLarge = 1e15f, kTooSmall = 1e-15f;  // squares leave float's range

// What one reading of the matrix tells.
struct Reading {
  double square = 0;    // ||A||^2
  float largest = 0;
};

// The blocks of a source, checked and multiplied by a power of two.
class Blocks {
 public:
  Blocks(const RowSource& source, const SvdOptions& options, int64_t at_least)
      : source_(source),
        rows_(std::clamp<int64_t>(options.block_bytes / (4 * source.cols()),
                                  std::min<int64_t>(at_least, 64), source.rows())) {}

  // Calls function(first row, block) for all blocks.
  Status ForEach(const std::function<Status(int64_t, ViewF)>& function) {
    scratch_.resize(static_cast<size_t>(rows_ * source_.cols()));
    for (int64_t first = 0; first < source_.rows(); first += rows_) {
      const int64_t count = std::min(rows_, source_.rows() - first);
      MESORIG_ASSIGN_OR_RETURN(ViewF block, source_.Rows(first, count, scratch_.data()));
      MESORIG_RETURN_IF_ERROR(function(first, scale_ == 1 ? block : Scaled(block)));
    }
    return OkStatus();
  }

  // Adds up the norm and looks for what is not finite.
  static Status Look(int64_t first, ViewF block, Reading& reading) {
    for (int64_t j = 0; j < block.cols; ++j) {
      const float* const column = block.data + j * block.stride;
      double square = 0;
      float largest = 0;
      for (int64_t i = 0; i < block.rows; ++i) {
        square += static_cast<double>(column[i]) * static_cast<double>(column[i]);
        largest = std::max(largest, std::abs(column[i]));
      }
      if (!std::isfinite(square)) {
        for (int64_t i = 0; i < block.rows; ++i) {
          if (std::isfinite(column[i])) continue;
          return InvalidArgument("row {}, column {} holds {}, which is not finite", first + i, j,
                                 column[i]);
        }
      }
      reading.square += square;
      reading.largest = std::max(reading.largest, largest);
    }
    return OkStatus();
  }

  void set_scale(float scale) { scale_ = scale; }
  float scale() const { return scale_; }

 private:
  ViewF Scaled(ViewF block) {
    scaled_.resize(static_cast<size_t>(block.rows * block.cols));
    for (int64_t j = 0; j < block.cols; ++j) {
      const float* const from = block.data + j * block.stride;
      std::transform(from, from + block.rows, scaled_.data() + j * block.rows,
                     [this](float x) { return x * scale_; });
    }
    return {scaled_.data(), block.rows, block.cols, block.rows};
  }

  const RowSource& source_;
  int64_t rows_;
  float scale_ = 1;
  std::vector<float> scratch_, scaled_;
};

// A small or turned matrix, whole.
StatusOr<MatrixF> Whole(const RowSource& source, Reading& reading) {
  MatrixF all(source.rows(), source.cols());
  std::vector<float> scratch(all.values.size());
  MESORIG_ASSIGN_OR_RETURN(const ViewF view, source.Rows(0, source.rows(), scratch.data()));
  MESORIG_RETURN_IF_ERROR(Blocks::Look(0, view, reading));
  for (int64_t j = 0; j < all.cols; ++j) {
    const float* const from = view.data + j * view.stride;
    std::copy(from, from + all.rows, all.Column(j));
  }
  return all;
}

template <typename T>
MatrixF FirstColumns(const Matrix<T>& m, int64_t count) {
  MatrixF out(m.rows, count);
  std::transform(m.values.begin(), m.values.begin() + m.rows * count, out.values.begin(),
                 [](T x) { return static_cast<float>(x); });
  return out;
}

double Residual(double square, const std::vector<double>& sigma) {
  double rest = square;
  for (const double s : sigma) rest -= s * s;
  return square > 0 ? std::sqrt(std::max(0.0, rest) / square) : 0;
}

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

// The work on a large matrix, in the units of Blocks::scale().
class Sketch {
 public:
  Sketch(const RowSource& source, const SvdOptions& options, int64_t rank)
      : source_(source), options_(options), rank_(rank),
        width_(std::min({rank + std::max<int64_t>(options.oversampling, 0), source.rows(),
                         source.cols()})),
        blocks_(source, options, width_) {}

  StatusOr<TruncatedSvd> Randomised() {
    MESORIG_RETURN_IF_ERROR(Start([this] { return Gaussian(); }));
    MESORIG_RETURN_IF_ERROR(PowerSteps(options_.max_power_steps));
    return Finish(SvdMethod::kRandomised);
  }

  StatusOr<TruncatedSvd> Gram() {
    bool visible = true;
    MESORIG_RETURN_IF_ERROR(Start([&] { return Eigenvectors(visible); }));
    if (!visible) MESORIG_RETURN_IF_ERROR(PowerSteps(std::max(options_.max_power_steps, 2)));
    return Finish(SvdMethod::kGram);
  }

 private:
  // The first basis. Again, scaled, where squares would leave float's range.
  Status Start(const std::function<Status()>& basis) {
    MESORIG_RETURN_IF_ERROR(basis());
    const float largest = reading_.largest;
    if (largest == 0 || (largest >= kTooSmall && largest <= kTooLarge)) return OkStatus();
    int exponent = 0;
    std::frexp(largest, &exponent);
    blocks_.set_scale(std::ldexp(1.0f, std::clamp(-exponent, -126, 126)));
    return basis();
  }

  // Q = orth(A^T G), G Gaussian.
  Status Gaussian() {
    std::mt19937_64 random(options_.seed);
    std::normal_distribution<float> normal;
    reading_ = {};
    q_ = MatrixF(source_.cols(), width_);
    MESORIG_RETURN_IF_ERROR(ForEachSeen([&](ViewF block) {
      MatrixF g(block.rows, width_);
      for (float& x : g.values) x = normal(random);
      MultiplyInto(block, true, g, false, 1.0f, q_.values.data(), q_.rows);
    }));
    return InRange() ? Orthonormalise(q_) : OkStatus();
  }

  // Q = the leading eigenvectors of A^T A.
  Status Eigenvectors(bool& visible) {
    reading_ = {};
    MatrixD gram(source_.cols(), source_.cols());
    MESORIG_RETURN_IF_ERROR(ForEachSeen([&](ViewF block) {
      AddGram(block, gram);
    }));
    std::vector<double> values;
    MESORIG_RETURN_IF_ERROR(SymmetricEigen(gram, values));
    visible = values[static_cast<size_t>(width_ - 1)] > kGramVisible * values[0] || values[0] <= 0;
    q_ = FirstColumns(gram, width_);
    return OkStatus();
  }

  // Adds each block to reading_ before it calls function(block).
  Status ForEachSeen(const std::function<void(ViewF)>& function) {
    return blocks_.ForEach([&](int64_t first, ViewF block) {
      const Status seen = Blocks::Look(first, block, reading_);
      if (seen.ok()) function(block);
      return seen;
    });
  }

  bool InRange() const { return reading_.largest <= kTooLarge; }

  // Q <- orth(A^T (A Q)); on the way the energy that `rank` terms of the old Q capture.
  Status PowerSteps(int steps) {
    double before = 0;
    for (int step = 0; step < steps; ++step) {
      MatrixF next(q_.rows, width_);
      MatrixD gram(width_, width_);
      MESORIG_RETURN_IF_ERROR(blocks_.ForEach([&](int64_t, ViewF block) {
        const MatrixF z = Multiply(block, false, q_, false);
        AddGram(z, gram);
        MultiplyInto(block, true, z, false, 1.0f, next.values.data(), next.rows);
        return OkStatus();
      }));
      std::vector<double> energies;
      MESORIG_RETURN_IF_ERROR(SymmetricEigen(gram, energies));
      double captured = 0;
      for (int64_t k = 0; k < rank_; ++k) captured += energies[static_cast<size_t>(k)];
      q_ = std::move(next);
      MESORIG_RETURN_IF_ERROR(Orthonormalise(q_));
      ++power_steps_;
      // residual^2 falls by about twice the fraction by which the residual does.
      const double residual = std::max(0.0, reading_.square - captured);
      if (step > 0 && captured - before <= 2 * options_.stop * residual) break;
      before = captured;
    }
    return OkStatus();
  }

  // B = A Q = (U' R'), R = U'' sigma V''^T; U = U' U'', V = Q V''.
  StatusOr<TruncatedSvd> Finish(SvdMethod method) {
    MatrixF b(source_.rows(), width_);
    MESORIG_RETURN_IF_ERROR(blocks_.ForEach([&](int64_t first, ViewF block) {
      MultiplyInto(block, false, q_, false, 0.0f, b.values.data() + first, b.rows);
      return OkStatus();
    }));
    MatrixF r;
    MESORIG_RETURN_IF_ERROR(Orthonormalise(b, &r));
    MatrixD wide(r.rows, r.cols);
    std::copy(r.values.begin(), r.values.end(), wide.values.begin());
    MESORIG_ASSIGN_OR_RETURN(Svd svd, ThinSvd(std::move(wide)));
    TruncatedSvd result;
    result.u = Multiply(b, false, FirstColumns(svd.u, rank_), false);
    result.v = Multiply(q_, false, FirstColumns(svd.v, rank_), false);
    svd.sigma.resize(static_cast<size_t>(rank_));
    double square = reading_.square;
    result.residual = Residual(square, svd.sigma);
    for (double& s : svd.sigma) s /= blocks_.scale();
    result.sigma = std::move(svd.sigma);
    result.norm = std::sqrt(square) / blocks_.scale();
    result.power_steps = power_steps_;
    result.method = method;
    return result;
  }

  const RowSource& source_;
  const SvdOptions& options_;
  int64_t rank_, width_;
  Blocks blocks_;
  Reading reading_;
  MatrixF q_;
  int power_steps_ = 0;
};

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
