#include "processing/codecs/algebra/truncated_svd.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <random>

namespace mesorig::codecs::algebra {
namespace {

constexpr double kDirectFlops = 2e7;     // min^2 * max: milliseconds
constexpr int64_t kGramAlways = 512;     // cheaper than anything else, whatever the rank
constexpr int64_t kGramSide = 2048;      // eigenvectors of more take seconds
constexpr int64_t kGramPerTerm = 6;      // a Gram matrix costs what six vectors a term cost
constexpr int64_t kTurnedBytes = int64_t{128} << 20;  // a matrix that is turned is held whole
constexpr int64_t kSketchRowsPerVector = 24, kSketchedRows = 4;  // of A for one of the sketch, least
constexpr int kSketchPowerSteps = 2;
constexpr int64_t kMostBlockBytes = int64_t{512} << 20;  // of all threads together
constexpr double kOrthogonal = 1e-6;
constexpr int64_t kBasisBytes = int64_t{256} << 20;  // of a basis that grows, and its products
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
                                  std::min<int64_t>(at_least, 64), source.rows())),
        workers_(static_cast<int>(std::clamp<int64_t>(source.rows() / 64, 1, Threads()))) {
    const int64_t granule = source.granule();
    rows_ = std::min(rows_, (source.rows() + workers_ - 1) / workers_);
    rows_ = std::max<int64_t>(rows_ / granule, 1) * granule;
    const int64_t most = kMostBlockBytes / (4 * source.cols() * rows_);
    workers_ = static_cast<int>(std::clamp<int64_t>(most, 1, workers_));
    scratch_.resize(static_cast<size_t>(workers_));
    scaled_.resize(static_cast<size_t>(workers_));
  }

  // Calls function(worker, first row, block) for all blocks; see ForParts.
  Status ForEach(const std::function<Status(int, int64_t, ViewF)>& function) {
    return ForParts(workers_, source_.rows(), rows_, [&](int w, int64_t first, int64_t count) -> Status {
      auto& scratch = scratch_[static_cast<size_t>(w)];  // not touched, not there
      if (scratch == nullptr) {
        scratch = std::make_unique_for_overwrite<float[]>(static_cast<size_t>(rows_ * source_.cols()));
      }
      MESORIG_ASSIGN_OR_RETURN(ViewF block, source_.Rows(first, count, scratch.get()));
      return function(w, first, scale_ == 1 ? block : Scaled(block, scaled_[static_cast<size_t>(w)]));
    });
  }
  int workers() const { return workers_; }

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
  ViewF Scaled(ViewF block, std::vector<float>& scaled) const {
    scaled.resize(static_cast<size_t>(block.rows * block.cols));
    for (int64_t j = 0; j < block.cols; ++j) {
      const float* const from = block.data + j * block.stride;
      std::transform(from, from + block.rows, scaled.data() + j * block.rows,
                     [this](float x) { return x * scale_; });
    }
    return {scaled.data(), block.rows, block.cols, block.rows};
  }

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
    MESORIG_RETURN_IF_ERROR(Start([this] { return First(); }));
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

  // Numbers of a row's own, whatever the blocks (splitmix64).
  uint64_t Draw(int64_t row) const {
    uint64_t x = options_.seed * 0xd1342543de82ef95u + static_cast<uint64_t>(row) * 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
  }

  // The first basis of the randomised way: of S A where S, whose rows are far fewer than A's but far
  // more than the vectors looked for, costs no more than reading A; else of G A, G Gaussian.
  Status First() {
    const int64_t rows = std::min(options_.block_bytes / (4 * source_.cols()),
                                  kSketchRowsPerVector * width_);
    if (rows < 4 * width_ || rows > source_.rows() / kSketchedRows) return Gaussian();
    return CountSketch(rows);
  }

  // S adds each row of A, with a random sign, to one of `rows` sums (Clarkson and Woodruff 2013): a
  // matrix whose leading right singular vectors are nearly those of A.
  Status CountSketch(int64_t rows) {
    Sums<float> sums(blocks_.workers(), rows, source_.cols());
    MESORIG_RETURN_IF_ERROR(ForEachSeen([&](int worker, int64_t first, ViewF block) {
      std::vector<std::pair<uint32_t, float>> to;
      for (int64_t i = 0; i < block.rows; ++i) {
        const uint64_t draw = Draw(first + i);
        to.emplace_back(static_cast<uint32_t>((draw >> 32) * static_cast<uint64_t>(rows) >> 32),
                        (draw & 1) != 0 ? 1.0f : -1.0f);
      }
      MatrixF& sum = sums.of(worker);
      for (int64_t j = 0; j < block.cols; ++j) {
        const float* const from = block.data + j * block.stride;
        float* const column = sum.Column(j);
        for (size_t i = 0; i < to.size(); ++i) column[to[i].first] += to[i].second * from[i];
      }
    }));
    if (!InRange()) return OkStatus();
    const MatrixF sketch = sums.Total();
    SvdOptions options = options_;
    options.rank = width_;
    options.method = SvdMethod::kRandomised;
    options.max_power_steps = kSketchPowerSteps;
    MESORIG_ASSIGN_OR_RETURN(TruncatedSvd svd, DecomposeTruncated(DenseSource(sketch), options));
    q_ = std::move(svd.v);
    return OkStatus();
  }

  // Q = orth(A^T G), G Gaussian: each row of it from a generator of its own.
  Status Gaussian() {
    Sums<float> sums(blocks_.workers(), source_.cols(), width_);
    MESORIG_RETURN_IF_ERROR(ForEachSeen([&](int worker, int64_t first, ViewF block) {
      MatrixF g(block.rows, width_);
      for (int64_t i = 0; i < g.rows; ++i) {
        std::minstd_rand random(static_cast<uint32_t>(Draw(first + i)));
        std::normal_distribution<float> normal;
        for (int64_t j = 0; j < width_; ++j) g(i, j) = normal(random);
      }
      MatrixF& sum = sums.of(worker);
      MultiplyInto(block, true, g, false, 1.0f, sum.values.data(), sum.rows);
    }));
    q_ = sums.Total();
    return InRange() ? Orthonormalise(q_) : OkStatus();
  }

  // Q = the leading eigenvectors of A^T A.
  Status Eigenvectors(bool& visible) {
    Sums<double> sums(blocks_.workers(), source_.cols(), source_.cols());
    MESORIG_RETURN_IF_ERROR(ForEachSeen(
        [&](int worker, int64_t, ViewF block) { AddGram(block, sums.of(worker)); }));
    MatrixD gram = sums.Total();
    std::vector<double> values;
    MESORIG_RETURN_IF_ERROR(SymmetricEigen(gram, values));
    visible = values[static_cast<size_t>(width_ - 1)] > kGramVisible * values[0] || values[0] <= 0;
    q_ = FirstColumns(gram, width_);
    return OkStatus();
  }

  // Looks at each block before it calls function(worker, first, block); reading_ is what was seen.
  Status ForEachSeen(const std::function<void(int, int64_t, ViewF)>& function) {
    std::vector<Reading> readings(static_cast<size_t>(blocks_.workers()));
    MESORIG_RETURN_IF_ERROR(blocks_.ForEach([&](int worker, int64_t first, ViewF block) {
      const Status seen = Blocks::Look(first, block, readings[static_cast<size_t>(worker)]);
      if (seen.ok()) function(worker, first, block);
      return seen;
    }));
    reading_ = {};
    for (const Reading& r : readings) {
      reading_.square += r.square;
      reading_.largest = std::max(reading_.largest, r.largest);
    }
    return OkStatus();
  }

  bool InRange() const { return reading_.largest <= kTooLarge; }

  // How many blocks of width_ vectors the basis may grow to.
  int64_t MostBlocks(int steps) const {
    const int64_t side = std::min(source_.rows(), source_.cols()) / width_;
    const int64_t bytes = 4 * width_ * (source_.rows() + source_.cols());
    return std::clamp<int64_t>(std::min(side, kBasisBytes / bytes), 1, steps + 1);
  }

  // Q <- orth([Q, A^T (A q)]), q what was added last (block Lanczos): a step costs no more reading and
  // no more products with A than one of Q <- orth(A^T (A Q)), to which it falls back where the basis
  // would become too large, and its span holds what all of those have found.
  Status PowerSteps(int steps) {
    const int64_t most = MostBlocks(steps);
    if (most == 1) return PlainPowerSteps(steps);
    for (int step = 0; step < std::min<int64_t>(steps, most - 1); ++step) {
      MatrixF next, z;
      MESORIG_RETURN_IF_ERROR(MultiplyNewest(z, &next));
      AddProducts(z);
      ++power_steps_;
      MESORIG_ASSIGN_OR_RETURN(const double gain, Gain(next));
      MESORIG_RETURN_IF_ERROR(Extend(std::move(next)));
      // What this step has found lowers residual^2 by about `gain`; what another one would find, by
      // less than its square (the gaps that both see are the same), residual by half of that.
      if (gain * gain <= 2 * options_.stop) break;
    }
    return OkStatus();
  }

  // The part of residual^2 that the newest vectors' images `next` = A^T A q are about to explain, to
  // first order: for each of the leading Ritz pairs |A^T A x - lambda x|^2 / (lambda - mu), mu the
  // smallest Ritz value; of Krylov spaces only the newest block's images leave their span.
  StatusOr<double> Gain(const MatrixF& next) {
    MatrixD vectors = gram_;
    std::vector<double> energies;
    MESORIG_RETURN_IF_ERROR(SymmetricEigen(vectors, energies));
    MatrixF outside = next;
    MatrixF known = Multiply(q_, true, next, false);
    for (float& x : known.values) x = -x;
    MultiplyInto(q_, false, known, false, 1.0f, outside.values.data(), outside.rows);
    MatrixF coefficients(next.cols, rank_);  // of the Ritz vectors in the newest block
    for (int64_t k = 0; k < rank_; ++k) {
      for (int64_t i = 0; i < next.cols; ++i) {
        coefficients(i, k) = static_cast<float>(vectors(vectors.rows - next.cols + i, k));
      }
    }
    const MatrixF rest = Multiply(outside, false, coefficients, false);
    double gain = 0, left = reading_.square;
    for (int64_t k = 0; k < rank_; ++k) {
      double square = 0;
      for (int64_t i = 0; i < rest.rows; ++i) square += std::pow(static_cast<double>(rest(i, k)), 2);
      const double lambda = energies[static_cast<size_t>(k)], gap = lambda - energies.back();
      gain += std::min(square / std::max(gap, 1e-3 * lambda + 1e-300), lambda);
      left -= lambda;
    }
    return left > 1e-12 * reading_.square ? gain / left : 0.0;
  }

  // Q <- orth(A^T (A Q)); on the way the energy that `rank` terms of the old Q capture.
  Status PlainPowerSteps(int steps) {
    double before = 0;
    for (int step = 0; step < steps; ++step) {
      MatrixF next, z;
      MESORIG_RETURN_IF_ERROR(MultiplyNewest(z, &next));
      MatrixD gram(z.cols, z.cols);
      AddGram(z, gram);
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

  // The columns of the basis whose products are not in b_ yet.
  ViewF Newest() const {
    return {q_.Column(b_.cols), q_.rows, q_.cols - b_.cols, q_.rows};
  }

  // z = A q, and next = A^T z where it is asked for.
  Status MultiplyNewest(MatrixF& z, MatrixF* next) {
    const ViewF newest = Newest();
    z = MatrixF(source_.rows(), newest.cols);
    Sums<float> sums(next == nullptr ? 0 : blocks_.workers(), q_.rows, newest.cols);
    MESORIG_RETURN_IF_ERROR(blocks_.ForEach([&](int worker, int64_t first, ViewF block) {
      MultiplyInto(block, false, newest, false, 0.0f, z.values.data() + first, z.rows);
      if (next == nullptr) return OkStatus();
      MatrixF& sum = sums.of(worker);
      MultiplyInto(block, true, {z.values.data() + first, block.rows, z.cols, z.rows}, false, 1.0f,
                   sum.values.data(), sum.rows);
      return OkStatus();
    }));
    if (next != nullptr) *next = sums.Total();
    return OkStatus();
  }

  // Appends z to b_, and the products with it to gram_ = b_^T b_.
  void AddProducts(const MatrixF& z) {
    b_.rows = z.rows;
    b_.cols += z.cols;
    b_.values.insert(b_.values.end(), z.values.begin(), z.values.end());
    MatrixD cross(b_.cols, z.cols);
    AddProduct(b_, z, cross);
    MatrixD gram(b_.cols, b_.cols);
    for (int64_t j = 0; j < gram_.cols; ++j) std::copy_n(gram_.Column(j), gram_.rows, gram.Column(j));
    for (int64_t j = 0; j < z.cols; ++j) {
      for (int64_t i = 0; i < b_.cols; ++i) {
        gram(i, gram_.cols + j) = gram(gram_.cols + j, i) = cross(i, j);
      }
    }
    gram_ = std::move(gram);
  }

  // Appends to the basis an orthonormal basis of what `next` adds to its span. Gram and Schmidt twice;
  // where little is left of `next` that is not enough, and all of it is done by reflections.
  Status Extend(MatrixF next) {
    for (int round = 0; round < 2 && q_.cols > 0; ++round) {
      MatrixF known = Multiply(q_, true, next, false);
      for (float& x : known.values) x = -x;
      MultiplyInto(q_, false, known, false, 1.0f, next.values.data(), next.rows);
      MESORIG_RETURN_IF_ERROR(Orthonormalise(next));
    }
    if (q_.cols == 0) MESORIG_RETURN_IF_ERROR(Orthonormalise(next));
    const int64_t known = q_.cols;
    MatrixD cross(known, next.cols);
    if (known > 0) AddProduct(q_, next, cross);
    q_.rows = next.rows;
    q_.cols += next.cols;
    q_.values.insert(q_.values.end(), next.values.begin(), next.values.end());
    if (std::all_of(cross.values.begin(), cross.values.end(),
                    [](double x) { return std::abs(x) < kOrthogonal; })) {
      return OkStatus();
    }
    return Straighten(q_);
  }

  // Orthonormal columns that stand where nearly orthonormal ones stood.
  static Status Straighten(MatrixF& q) {
    MatrixF r;
    MESORIG_RETURN_IF_ERROR(Orthonormalise(q, &r));
    for (int64_t j = 0; j < q.cols; ++j) {
      if (r(j, j) > 0) continue;
      for (int64_t i = 0; i < q.rows; ++i) q(i, j) = -q(i, j);
    }
    return OkStatus();
  }

  // B = A Q; W the leading eigenvectors of B^T B; B W = U' R, R = U'' sigma V''^T; U = U' U'',
  // V = Q W V''.
  StatusOr<TruncatedSvd> Finish(SvdMethod method) {
    if (Newest().cols > 0) {
      MatrixF z;
      MESORIG_RETURN_IF_ERROR(MultiplyNewest(z, nullptr));
      AddProducts(z);
    }
    std::vector<double> energies;
    MESORIG_RETURN_IF_ERROR(SymmetricEigen(gram_, energies));
    const MatrixF w = FirstColumns(gram_, rank_);
    MatrixF u = Multiply(b_, false, w, false), r;
    MESORIG_RETURN_IF_ERROR(Orthonormalise(u, &r));
    MatrixD wide(r.rows, r.cols);
    std::copy(r.values.begin(), r.values.end(), wide.values.begin());
    MESORIG_ASSIGN_OR_RETURN(Svd svd, ThinSvd(std::move(wide)));
    TruncatedSvd result;
    result.u = Multiply(u, false, FirstColumns(svd.u, rank_), false);
    result.v = Multiply(Multiply(q_, false, w, false), false, FirstColumns(svd.v, rank_), false);
    MESORIG_RETURN_IF_ERROR(Straighten(result.v));
    const double square = reading_.square;
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
  MatrixF q_;     // the basis, orthonormal columns
  MatrixF b_;     // A times its first columns
  MatrixD gram_;  // b_^T b_
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
