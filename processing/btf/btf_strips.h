#pragma once
// An uncompressed BTF file, read in strips of rows: what encoders read that never hold it whole.

#include <filesystem>
#include <memory>
#include <span>

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
  // Rows [row, row + rows) of the images of `pairs` (v * nL + l, ascending, all present):
  // out[(3 i + rgb) * rows * W + texel of the strip]. InvalidArgument names view and light where a
  // value is not finite. Calls from several threads take turns; a scan line is unpacked once a call,
  // all its lights with it.
  Status Read(int row, int rows, std::span<const size_t> pairs, float* out) const;

 private:
  struct File;
  explicit BtfStrips(std::unique_ptr<File> file);
  std::unique_ptr<File> file_;
};

}  // namespace mesorig::btf
