#include "processing/codecs/linear/sample_source.h"

#include <algorithm>

#include "processing/codecs/algebra/threads.h"
#include "protocol/base/check.h"

namespace mesorig::codecs {
namespace {

constexpr int64_t kMostRowBytes = int64_t{64} << 20;
constexpr int64_t kMostBlockBytes = int64_t{512} << 20;  // of all workers together

// `count` texels from texels[k] on follow one another, and none of them lies beyond `end`.
size_t RunFrom(std::span<const size_t> texels, size_t k, size_t end) {
  size_t run = 1;
  while (k + run < texels.size() && texels[k + run] < end) ++run;
  return run;
}

// The texels that it was given, column by column.
class HeldSource final : public SampleSource {
 public:
  HeldSource(const SampleSource& source, std::vector<size_t> texels)
      : source_(source), pairs_(source.Pairs()), texels_(std::move(texels)),
        values_(3 * pairs_.size() * texels_.size()) {}

  Status Read(int64_t block_bytes) {
    const BlockSizes blocks =
        BlocksOf(source_, 12 * static_cast<int64_t>(pairs_.size()), block_bytes);
    std::vector<float> scratch;
    for (size_t k = 0; k < texels_.size();) {
      const auto size = static_cast<size_t>(blocks.texels);
      const size_t end = texels_[k] / size * size + size, run = RunFrom(texels_, k, end);
      scratch.resize(3 * pairs_.size() * run);
      MESORIG_RETURN_IF_ERROR(
          source_.Gather(std::span(texels_).subspan(k, run), pairs_, scratch.data()));
      for (size_t j = 0; j < 3 * pairs_.size(); ++j) {
        std::copy_n(scratch.data() + j * run, run, values_.data() + j * texels_.size() + k);
      }
      k += run;
    }
    return OkStatus();
  }

  const btf::BtfHeader& header() const override { return source_.header(); }
  const std::vector<uint8_t>& present() const override { return source_.present(); }
  int64_t granule() const override { return 1; }
  Status Columns(int64_t first, int64_t count, std::span<const size_t> pairs,
                 float* out) const override {
    std::vector<size_t> texels(static_cast<size_t>(count));
    for (size_t k = 0; k < texels.size(); ++k) texels[k] = static_cast<size_t>(first) + k;
    return Gather(texels, pairs, out);
  }
  Status Gather(std::span<const size_t> texels, std::span<const size_t> pairs,
                float* out) const override {
    std::vector<size_t> places;
    for (const size_t texel : texels) {
      const auto at = std::lower_bound(texels_.begin(), texels_.end(), texel);
      MESORIG_CHECK(at != texels_.end() && *at == texel);
      places.push_back(static_cast<size_t>(at - texels_.begin()));
    }
    for (const size_t pair : pairs) {
      const auto at = std::lower_bound(pairs_.begin(), pairs_.end(), pair) - pairs_.begin();
      for (size_t c = 0; c < 3; ++c, out += places.size()) {
        const float* const column =
            values_.data() + (3 * static_cast<size_t>(at) + c) * texels_.size();
        for (size_t k = 0; k < places.size(); ++k) out[k] = column[places[k]];
      }
    }
    return OkStatus();
  }
  bool has_variance() const override { return false; }
  Status Variances(int64_t, int64_t, std::span<const size_t>, float*) const override {
    return Unimplemented("variances of texels that are held");
  }
  bool in_memory() const override { return true; }

 private:
  const SampleSource& source_;
  std::vector<size_t> pairs_, texels_;
  std::vector<float> values_;  // [pair][rgb][texel]
};

}  // namespace

std::vector<size_t> SampleSource::Pairs() const {
  std::vector<size_t> pairs;
  for (size_t pair = 0; pair < present().size(); ++pair) {
    if (present()[pair] != 0) pairs.push_back(pair);
  }
  return pairs;
}

Status SampleSource::Gather(std::span<const size_t> texels, std::span<const size_t> pairs,
                            float* out) const {
  const auto step = static_cast<size_t>(granule()), all = header().texel_count();
  std::vector<float> columns(3 * pairs.size() * std::min(step, all));
  for (size_t k = 0; k < texels.size();) {
    const size_t first = texels[k] / step * step, count = std::min(step, all - first);
    const size_t run = RunFrom(texels, k, first + count);
    MESORIG_RETURN_IF_ERROR(Columns(static_cast<int64_t>(first), static_cast<int64_t>(count), pairs,
                                    columns.data()));
    for (size_t j = 0; j < 3 * pairs.size(); ++j) {
      float* const to = out + j * texels.size() + k;
      for (size_t i = 0; i < run; ++i) to[i] = columns[j * count + texels[k + i] - first];
    }
    k += run;
  }
  return OkStatus();
}

MemorySource::MemorySource(const btf::SampledBtf& btf) : btf_(btf) {
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) present_.push_back(btf.Present(v, l) ? 1 : 0);
  }
}

Status MemorySource::Columns(int64_t first, int64_t count, std::span<const size_t> pairs,
                             float* out) const {
  const auto n = static_cast<size_t>(count);
  for (const size_t pair : pairs) {
    const float* const image = Image(pair).data() + 3 * first;
    for (size_t i = 0; i < n; ++i) {
      for (size_t c = 0; c < 3; ++c) out[c * n + i] = image[3 * i + c];
    }
    out += 3 * n;
  }
  return OkStatus();
}

Status MemorySource::Gather(std::span<const size_t> texels, std::span<const size_t> pairs,
                            float* out) const {
  for (const size_t pair : pairs) {
    const float* const image = Image(pair).data();
    for (size_t c = 0; c < 3; ++c, out += texels.size()) {
      for (size_t i = 0; i < texels.size(); ++i) out[i] = image[3 * texels[i] + c];
    }
  }
  return OkStatus();
}

Status MemorySource::Variances(int64_t first, int64_t count, std::span<const size_t> pairs,
                               float* out) const {
  const size_t lights = header().lights.size();
  for (const size_t pair : pairs) {
    const auto of_pair =
        btf_.Variance(static_cast<int>(pair / lights), static_cast<int>(pair % lights));
    out = std::copy_n(of_pair.data() + first, count, out);
  }
  return OkStatus();
}

FileSource::FileSource(btf::BtfStrips strips) : strips_(std::move(strips)) {
  const int64_t bytes = 12 * std::max<int64_t>(static_cast<int64_t>(Pairs().size()), 1);
  granule_ = std::clamp<int64_t>(kMostRowBytes / bytes, 1, header().width);
}

StatusOr<std::unique_ptr<SampleSource>> Hold(const SampleSource& source, std::vector<size_t> texels,
                                             int64_t block_bytes) {
  auto held = std::make_unique<HeldSource>(source, std::move(texels));
  MESORIG_RETURN_IF_ERROR(held->Read(block_bytes));
  return std::unique_ptr<SampleSource>(std::move(held));
}

BlockSizes BlocksOf(const SampleSource& source, int64_t bytes_per_texel, int64_t block_bytes) {
  const auto texels = static_cast<int64_t>(source.header().texel_count());
  const int64_t granule = source.granule(), workers = algebra::Threads();
  BlockSizes sizes;
  sizes.texels = std::clamp<int64_t>(block_bytes / std::max<int64_t>(bytes_per_texel, 1), 1,
                                     (texels + workers - 1) / workers);
  sizes.texels = std::max<int64_t>(sizes.texels / granule, 1) * granule;
  const int64_t most = kMostBlockBytes / std::max<int64_t>(bytes_per_texel * sizes.texels, 1);
  sizes.workers = static_cast<int>(std::clamp<int64_t>(most, 1, workers));
  return sizes;
}

Status ForSampleBlocks(const SampleSource& source, int64_t block_bytes,
                       const std::function<Status(int, int64_t, int64_t, const float*)>& function) {
  const std::vector<size_t> pairs = source.Pairs();
  const BlockSizes blocks =
      BlocksOf(source, 12 * static_cast<int64_t>(pairs.size()), block_bytes);
  std::vector<std::unique_ptr<float[]>> scratch(static_cast<size_t>(blocks.workers));
  return algebra::ForParts(
      blocks.workers, static_cast<int64_t>(source.header().texel_count()), blocks.texels,
      [&](int worker, int64_t first, int64_t count) -> Status {
        auto& own = scratch[static_cast<size_t>(worker)];
        if (own == nullptr) {
          own = std::make_unique_for_overwrite<float[]>(3 * pairs.size() *
                                                        static_cast<size_t>(blocks.texels));
        }
        MESORIG_RETURN_IF_ERROR(source.Columns(first, count, pairs, own.get()));
        return function(worker, first, count, own.get());
      });
}

}  // namespace mesorig::codecs
