#include "processing/codecs/algebra/svd_blocks.h"

#include <cmath>

namespace mesorig::codecs::algebra {
namespace {

constexpr int64_t kMostBlockBytes = int64_t{512} << 20;  // of all threads together

}  // namespace

Blocks::Blocks(const RowSource& source, const SvdOptions& options, int64_t at_least)
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

Status Blocks::ForEach(const std::function<Status(int, int64_t, ViewF)>& function) {
  return ForParts(workers_, source_.rows(), rows_, [&](int w, int64_t first, int64_t count) -> Status {
    auto& scratch = scratch_[static_cast<size_t>(w)];  // not touched, not there
    if (scratch == nullptr) {
      scratch = std::make_unique_for_overwrite<float[]>(static_cast<size_t>(rows_ * source_.cols()));
    }
    MESORIG_ASSIGN_OR_RETURN(ViewF block, source_.Rows(first, count, scratch.get()));
    return function(w, first, scale_ == 1 ? block : Scaled(block, scaled_[static_cast<size_t>(w)]));
  });
}

Status Blocks::Look(int64_t first, ViewF block, Reading& reading) {
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

ViewF Blocks::Scaled(ViewF block, std::vector<float>& scaled) const {
  scaled.resize(static_cast<size_t>(block.rows * block.cols));
  for (int64_t j = 0; j < block.cols; ++j) {
    const float* const from = block.data + j * block.stride;
    std::transform(from, from + block.rows, scaled.data() + j * block.rows,
                   [this](float x) { return x * scale_; });
  }
  return {scaled.data(), block.rows, block.cols, block.rows};
}

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

}  // namespace mesorig::codecs::algebra
