#pragma once
// Where encoders read the samples of a BTF from: memory, or strips of a file that is never held whole.

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "processing/btf/btf_strips.h"
#include "processing/btf/sampled_btf.h"

namespace mesorig::codecs {

// Texels are counted row by row from the top. Pairs are v * nL + l, ascending, all present. Reentrant.
class SampleSource {
 public:
  virtual ~SampleSource() = default;
  virtual const btf::BtfHeader& header() const = 0;
  // v * nL + l; 1 is present.
  virtual const std::vector<uint8_t>& present() const = 0;
  // Texels are best asked for from multiples of this on, by multiples.
  virtual int64_t granule() const = 0;
  // Samples of present pairs: out[(3 i + rgb) * count + k] is texel first + k of pairs[i].
  virtual Status Columns(int64_t first, int64_t count, std::span<const size_t> pairs,
                         float* out) const = 0;
  // The same of texels that need not follow one another, ascending: out[(3 i + rgb) * texels.size() + k]
  // is texels[k]. As it is here, granules are read that hold any of them, one after the other.
  virtual Status Gather(std::span<const size_t> texels, std::span<const size_t> pairs,
                        float* out) const;
  virtual bool has_variance() const = 0;
  // Variances: out[i * count + k] is texel first + k of pairs[i]. Only where there are any.
  virtual Status Variances(int64_t first, int64_t count, std::span<const size_t> pairs,
                           float* out) const = 0;
  // Whether reading twice costs no more than memory does.
  virtual bool in_memory() const { return false; }

  // The pairs that are present, ascending.
  std::vector<size_t> Pairs() const;
};

// Borrows the BTF.
class MemorySource final : public SampleSource {
 public:
  explicit MemorySource(const btf::SampledBtf& btf);
  const btf::BtfHeader& header() const override { return btf_.header(); }
  const std::vector<uint8_t>& present() const override { return present_; }
  int64_t granule() const override { return 1; }
  Status Columns(int64_t first, int64_t count, std::span<const size_t> pairs,
                 float* out) const override;
  Status Gather(std::span<const size_t> texels, std::span<const size_t> pairs,
                float* out) const override;
  bool has_variance() const override { return btf_.has_variance(); }
  Status Variances(int64_t first, int64_t count, std::span<const size_t> pairs,
                   float* out) const override;
  bool in_memory() const override { return true; }

 private:
  std::span<const float> Image(size_t pair) const {
    const size_t lights = header().lights.size();
    return btf_.Image(static_cast<int>(pair / lights), static_cast<int>(pair % lights));
  }

  const btf::SampledBtf& btf_;
  std::vector<uint8_t> present_;
};

class FileSource final : public SampleSource {
 public:
  explicit FileSource(btf::BtfStrips strips);
  const btf::BtfHeader& header() const override { return strips_.info().header; }
  const std::vector<uint8_t>& present() const override { return strips_.info().present; }
  // A row of texels, or less where a row of all pairs is larger than 64 MB.
  int64_t granule() const override { return granule_; }
  Status Columns(int64_t first, int64_t count, std::span<const size_t> pairs,
                 float* out) const override {
    return strips_.Read(first, count, pairs, out);
  }
  bool has_variance() const override { return strips_.has_variance(); }
  Status Variances(int64_t first, int64_t count, std::span<const size_t> pairs,
                   float* out) const override {
    return strips_.ReadVariance(first, count, pairs, out);
  }

 private:
  btf::BtfStrips strips_;
  int64_t granule_;
};

// A source of which some texels are held in memory, others are not to be asked for. Borrows the source.
// `texels` ascending. Reads the source once, by blocks of about `block_bytes`.
StatusOr<std::unique_ptr<SampleSource>> Hold(const SampleSource& source, std::vector<size_t> texels,
                                             int64_t block_bytes);

// How a source is read whole: blocks of so many texels (a multiple of the granule), by so many workers.
// About `block_bytes` a worker at `bytes_per_texel`, and all of them together 512 MB at most unless one
// granule is larger.
struct BlockSizes {
  int64_t texels = 1;
  int workers = 1;
};
BlockSizes BlocksOf(const SampleSource& source, int64_t bytes_per_texel, int64_t block_bytes);

// Calls function(worker, first, count, samples) for all blocks, samples as Columns gives them for the
// present pairs; see algebra::ForParts.
Status ForSampleBlocks(const SampleSource& source, int64_t block_bytes,
                       const std::function<Status(int, int64_t, int64_t, const float*)>& function);

}  // namespace mesorig::codecs
