#include <algorithm>
#include <cmath>
#include <random>

#include "processing/codecs/algebra/svd_sketch.h"

namespace mesorig::codecs::algebra {
namespace {

constexpr int64_t kSketchRowsPerVector = 24, kSketchedRows = 4;  // of A for one of the sketch, least
constexpr int kSketchPowerSteps = 2;
constexpr double kGramVisible = 1e-10;   // of the first eigenvalue: 1e-5 of the singular value

}  // namespace

Status Sketch::Start(const std::function<Status()>& basis) {
  MESORIG_RETURN_IF_ERROR(basis());
  const float largest = reading_.largest;
  if (largest == 0 || (largest >= kTooSmall && largest <= kTooLarge)) return OkStatus();
  int exponent = 0;
  std::frexp(largest, &exponent);
  blocks_.set_scale(std::ldexp(1.0f, std::clamp(-exponent, -126, 126)));
  return basis();
}

uint64_t Sketch::Draw(int64_t row) const {
  uint64_t x = options_.seed * 0xd1342543de82ef95u + static_cast<uint64_t>(row) * 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

Status Sketch::First() {
  const int64_t rows = std::min(options_.block_bytes / (4 * source_.cols()),
                                kSketchRowsPerVector * width_);
  if (rows < 4 * width_ || rows > source_.rows() / kSketchedRows) return Gaussian();
  return CountSketch(rows);
}

Status Sketch::CountSketch(int64_t rows) {
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

Status Sketch::Gaussian() {
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

Status Sketch::Eigenvectors(bool& visible) {
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

Status Sketch::ForEachSeen(const std::function<void(int, int64_t, ViewF)>& function) {
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

}  // namespace mesorig::codecs::algebra
