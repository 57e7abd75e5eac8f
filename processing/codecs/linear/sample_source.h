#pragma once
// Where encoders read the samples of a BTF from: memory, or strips of a file that is never held whole.

#include <memory>
#include <span>
#include <vector>

#include "processing/btf/btf_strips.h"
#include "processing/btf/sampled_btf.h"

namespace mesorig::codecs {

// Reentrant.
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

 private:
  const btf::SampledBtf& btf_;
  std::vector<uint8_t> present_;
};

class FileSource final : public SampleSource {
 public:
  explicit FileSource(btf::BtfStrips strips) : strips_(std::move(strips)) {}
  const btf::BtfHeader& header() const override { return strips_.info().header; }
  const std::vector<uint8_t>& present() const override { return strips_.info().present; }
  int64_t granule() const override { return header().width; }
  // InvalidArgument for texels that are not whole rows.
  Status Columns(int64_t first, int64_t count, std::span<const size_t> pairs,
                 float* out) const override;

 private:
  btf::BtfStrips strips_;
};

}  // namespace mesorig::codecs
