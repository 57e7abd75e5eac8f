#pragma once
// An uncompressed BTF file, read in strips of rows: what encoders read that never hold it whole.

#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "processing/btf/btf_file.h"

namespace mesorig::btf {

class BtfStrips {
 public:
  // InvalidArgument as ReadSampledBtf, but for the memory.
  static StatusOr<BtfStrips> Open(const std::filesystem::path& path);
  BtfStrips(BtfStrips&&) noexcept;
  BtfStrips& operator=(BtfStrips&&) noexcept;
  ~BtfStrips();

  const BtfFileInfo& info() const;
  bool has_variance() const;
  // Texels [first, first + count), row by row, of the images of `pairs` (v * nL + l, ascending, all
  // present): out[(3 i + rgb) * count + texel - first]. InvalidArgument names view and light where a
  // value is not finite. Calls from several threads take turns; a scan line is unpacked once a call,
  // all its lights with it, and where only a part of it is asked for held for a moment, a view at a
  // time.
  Status Read(int64_t first, int64_t count, std::span<const size_t> pairs, float* out) const;
  // Variances of the same, sr^-2: out[i * count + texel - first]. InvalidArgument for one that is
  // negative or not finite, and where the file has none.
  Status ReadVariance(int64_t first, int64_t count, std::span<const size_t> pairs, float* out) const;

 private:
  struct File;
  explicit BtfStrips(std::unique_ptr<File> file);
  // `channels` a pair, the first of light l called name(l, 0).
  Status ReadChannels(int64_t first, int64_t count, std::span<const size_t> pairs, size_t channels,
                      const std::function<std::string(int, size_t)>& name, float* out) const;
  std::unique_ptr<File> file_;
};

}  // namespace mesorig::btf
