#pragma once
// Internal to processing/btf: the only place that talks to OpenEXR. Its exceptions end here.

#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMultiPartInputFile.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::btf {

// One channel of a part in the caller's memory (borrowed during the call). Strides in elements.
template <typename T>
struct Slice {
  std::string channel;
  T* first;
  std::ptrdiff_t x_stride, y_stride;
};

// An open file whose headers were parsed once. Not thread-safe.
class ExrReader {
 public:
  static StatusOr<ExrReader> Open(const std::filesystem::path& path);
  int part_count() const { return file_->parts(); }
  const Imf::Header& header(int part) const { return file_->header(part); }
  // "" when the part has none.
  std::string PartName(int part) const;
  // All parts but part 0. InvalidArgument when two have one name.
  StatusOr<std::map<std::string, int>> PartsByName() const;
  uint64_t file_bytes() const { return file_bytes_; }
  const std::string& name() const { return name_; }
  // Width and height; InvalidArgument when the part is one that no BTF file has: origin not (0, 0),
  // sub-sampled channels, a lossy compression, or more samples than deflate could have packed into
  // this file.
  Status PartSize(int part, int& width, int& height) const;
  // Converts to float. A channel that the part lacks is an error.
  Status ReadPart(int part, const std::vector<Slice<float>>& slices) const;
  // Rows [row, row + rows) alone; `first` of each slice is where row `row` goes.
  Status ReadRows(int part, int row, int rows, const std::vector<Slice<float>>& slices) const;
  // Of UINT channels, without conversion.
  Status ReadPart(int part, const std::vector<Slice<uint32_t>>& slices) const;

 private:
  std::string name_;
  uint64_t file_bytes_ = 0;
  template <typename T>
  Status ReadSlices(int part, int row, int rows, const std::vector<Slice<T>>& slices) const;

  std::unique_ptr<Imf::MultiPartInputFile> file_;
};

// InvalidArgument when this machine does not have so many bytes of memory: asked before anything is
// allocated, since a file of a few bytes can claim any size.
Status CheckMemory(double bytes, const std::string& file);

// A part to be written. `header` has its attributes; channels, compression, name and type are set
// from what follows.
struct ChannelToWrite {
  std::string name;
  bool half = true;  // else float
  bool bits = false;  // UINT: what `fill` provides are bit patterns
};
struct PartToWrite {
  std::string name;
  int width = 0, height = 0;
  std::vector<ChannelToWrite> channels;
  Imf::Header header;
};
// All parts share `display_width` x `display_height`. `fill(part, channel, values)` provides the
// W*H float values of one channel, row by row; it is called part after part, and its values are
// dropped when the part is written. InvalidArgument for values that half or float cannot hold.
using FillChannel = std::function<void(size_t part, size_t channel, std::vector<float>& values)>;
Status WriteExr(const std::filesystem::path& path, int display_width, int display_height,
                std::vector<PartToWrite> parts, const FillChannel& fill);

}  // namespace mesorig::btf
