#include "processing/btf/exr_file.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfThreading.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <mutex>
#include <set>
#include <thread>

#include "processing/btf/exr_prescan.h"
#include "protocol/base/file_writer.h"

namespace mesorig::btf {
namespace {

constexpr uint64_t kDeflateLimit = 1100;  // deflate packs at most 1032 : 1
constexpr int kMaxThreads = 8;

// OpenEXR's pool is empty until somebody asks for threads.
void StartThreads() {
  static std::once_flag once;
  std::call_once(once, [] {
    const int cores = static_cast<int>(std::thread::hardware_concurrency());
    if (Imf::globalThreadCount() == 0) {
      Imf::setGlobalThreadCount(std::clamp(cores, 1, kMaxThreads));
    }
  });
}

// One line, without the path that some of OpenEXR's messages repeat.
std::string OneLine(std::string_view text) {
  std::string line;
  for (const char c : text) line.push_back(static_cast<unsigned char>(c) < 32 ? ' ' : c);
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return line;
}

template <typename Function>
Status GuardedRead(const std::string& name, const Function& function) {
  try {
    return function();
  } catch (const std::bad_alloc&) {
    return InvalidArgument("{}: needs more memory than there is", name);
  } catch (const std::exception& error) {
    return InvalidArgument("{}: damaged EXR file: {}", name, OneLine(error.what()));
  }
}

size_t BytesPerSample(Imf::PixelType type) { return type == Imf::HALF ? 2 : 4; }

template <typename T>
constexpr Imf::PixelType kPixelType = std::is_same_v<T, float>      ? Imf::FLOAT
                                      : std::is_same_v<T, uint32_t> ? Imf::UINT
                                                                    : Imf::HALF;

template <typename T>
void Insert(Imf::FrameBuffer& buffer, const Slice<T>& slice) {
  buffer.insert(slice.channel, Imf::Slice(kPixelType<T>, reinterpret_cast<char*>(slice.first),
                                          static_cast<size_t>(slice.x_stride) * sizeof(T),
                                          static_cast<size_t>(slice.y_stride) * sizeof(T)));
}

}  // namespace

StatusOr<ExrReader> ExrReader::Open(const std::filesystem::path& path) {
  MESORIG_RETURN_IF_ERROR(PrescanExr(path));
  StartThreads();
  ExrReader reader;
  reader.name_ = path.string();
  std::error_code error;
  reader.file_bytes_ = std::filesystem::file_size(path, error);
  MESORIG_RETURN_IF_ERROR(GuardedRead(reader.name_, [&] {
    reader.file_ = std::make_unique<Imf::MultiPartInputFile>(path.c_str(), Imf::globalThreadCount(),
                                                             /*reconstructChunkOffsetTable=*/false);
    return OkStatus();
  }));
  return reader;
}

std::string ExrReader::PartName(int part) const {
  return header(part).hasName() ? header(part).name() : std::string();
}

StatusOr<std::map<std::string, int>> ExrReader::PartsByName() const {
  std::map<std::string, int> parts;
  for (int part = 1; part < part_count(); ++part) {
    if (!parts.emplace(PartName(part), part).second) {
      return InvalidArgument("{}: part {} has the name of another", name_, part);
    }
  }
  return parts;
}

Status CheckMemory(double bytes, const std::string& file) {
  const double there =
      static_cast<double>(::sysconf(_SC_PHYS_PAGES)) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  if (bytes > there) {
    return InvalidArgument("{}: needs {:.1f} GB of memory, this machine has {:.1f} GB", file,
                           bytes * 1e-9, there * 1e-9);
  }
  return OkStatus();
}

Status ExrReader::PartSize(int part, int& width, int& height) const {
  const Imf::Header& h = header(part);
  const auto refuse = [&](std::string_view why) {
    return InvalidArgument("{}: part {} `{}` {}", name_, part, OneLine(PartName(part)), why);
  };
  if (h.hasType() && h.type() != Imf::SCANLINEIMAGE) return refuse("has no scan lines");
  const Imf::Compression c = h.compression();
  if (c != Imf::NO_COMPRESSION && c != Imf::RLE_COMPRESSION && c != Imf::ZIPS_COMPRESSION &&
      c != Imf::ZIP_COMPRESSION) {
    return refuse("is neither uncompressed nor ZIP, ZIPS or RLE");
  }
  const auto& box = h.dataWindow();
  if (box.min.x != 0 || box.min.y != 0) return refuse("does not start at pixel (0, 0)");
  if (box.max.x < 0 || box.max.y < 0) return refuse("is empty");
  uint64_t bytes_per_pixel = 0;
  for (auto channel = h.channels().begin(); channel != h.channels().end(); ++channel) {
    if (channel.channel().xSampling != 1 || channel.channel().ySampling != 1) {
      return refuse("has sub-sampled channels");
    }
    bytes_per_pixel += BytesPerSample(channel.channel().type);
  }
  const double bytes = (box.max.x + 1.0) * (box.max.y + 1.0) * static_cast<double>(bytes_per_pixel);
  if (bytes > static_cast<double>(kDeflateLimit * file_bytes_)) {
    return refuse("is larger than its file can hold");
  }
  width = box.max.x + 1;
  height = box.max.y + 1;
  return OkStatus();
}

template <typename T>
Status ExrReader::ReadSlices(int part, int row, int rows, const std::vector<Slice<T>>& slices) const {
  int width = 0, height = 0;
  MESORIG_RETURN_IF_ERROR(PartSize(part, width, height));
  if (rows < 0) rows = height;
  if (row < 0 || rows < 1 || rows > height - row) {
    return InvalidArgument("{}: part {} `{}` has {} rows, not {} to {}", name_, part,
                           OneLine(PartName(part)), height, row, row + rows - 1);
  }
  Imf::FrameBuffer buffer;
  for (const Slice<T>& slice : slices) {
    if (header(part).channels().findChannel(slice.channel) == nullptr) {
      return InvalidArgument("{}: part {} `{}` lacks channel {}", name_, part,
                             OneLine(PartName(part)), slice.channel);
    }
    Insert(buffer, Slice<T>{slice.channel, slice.first - row * slice.y_stride, slice.x_stride,
                            slice.y_stride});
  }
  return GuardedRead(name_, [&] {
    Imf::InputPart input(*file_, part);
    input.setFrameBuffer(buffer);
    input.readPixels(row, row + rows - 1);
    return OkStatus();
  });
}

Status ExrReader::ReadPart(int part, const std::vector<Slice<float>>& slices) const {
  return ReadSlices(part, 0, -1, slices);
}
Status ExrReader::ReadRows(int part, int row, int rows,
                           const std::vector<Slice<float>>& slices) const {
  return ReadSlices(part, row, std::max(rows, 0), slices);
}
Status ExrReader::ReadPart(int part, const std::vector<Slice<uint32_t>>& slices) const {
  return ReadSlices(part, 0, -1, slices);
}

namespace {

Imf::Header FinishedHeader(const PartToWrite& part, int display_width, int display_height) {
  Imf::Header h = part.header;
  h.displayWindow() = {{0, 0}, {display_width - 1, display_height - 1}};
  h.dataWindow() = {{0, 0}, {part.width - 1, part.height - 1}};
  h.compression() = Imf::ZIPS_COMPRESSION;
  h.setName(part.name);
  h.setType(Imf::SCANLINEIMAGE);
  for (const ChannelToWrite& channel : part.channels) {
    h.channels().insert(channel.name, Imf::Channel(channel.bits   ? Imf::UINT
                                                  : channel.half ? Imf::HALF
                                                                 : Imf::FLOAT));
  }
  return h;
}

// `values` as T in `storage`, for the channel of `buffer`.
template <typename T>
Status Convert(const PartToWrite& part, const std::string& channel,
               const std::vector<float>& values, std::vector<char>& storage,
               Imf::FrameBuffer& buffer) {
  storage.resize(values.size() * sizeof(T));
  T* const first = reinterpret_cast<T*>(storage.data());
  for (size_t i = 0; i < values.size(); ++i) {
    first[i] = T(values[i]);
    if (!std::isfinite(static_cast<float>(first[i]))) {
      return InvalidArgument("part {} channel {} texel {}: {} cannot be stored", part.name, channel,
                             i, values[i]);
    }
  }
  Insert(buffer, Slice<T>{channel, first, 1, part.width});
  return OkStatus();
}

Status WritePart(Imf::MultiPartOutputFile& file, size_t index, const PartToWrite& part,
                 const FillChannel& fill) {
  const size_t texels = static_cast<size_t>(part.width) * static_cast<size_t>(part.height);
  std::vector<std::vector<char>> pixels(part.channels.size());
  std::vector<float> values;
  Imf::FrameBuffer buffer;
  for (size_t c = 0; c < part.channels.size(); ++c) {
    const auto& [name, half, bits] = part.channels[c];
    values.assign(texels, 0.0f);
    fill(index, c, values);
    if (bits) {
      const auto* const first = reinterpret_cast<const char*>(values.data());
      pixels[c].assign(first, first + texels * sizeof(uint32_t));
      Insert(buffer, Slice<uint32_t>{name, reinterpret_cast<uint32_t*>(pixels[c].data()), 1,
                                     part.width});
      continue;
    }
    MESORIG_RETURN_IF_ERROR(half ? Convert<Imath::half>(part, name, values, pixels[c], buffer)
                                 : Convert<float>(part, name, values, pixels[c], buffer));
  }
  Imf::OutputPart output(file, static_cast<int>(index));
  output.setFrameBuffer(buffer);
  output.writePixels(part.height);
  return OkStatus();
}

// OpenEXR's own stream is closed by a destructor, and tables of offsets are written by another: both
// keep silent about a disk that is full. This one remembers.
class CheckedStream final : public Imf::OStream {
 public:
  explicit CheckedStream(const std::filesystem::path& path)
      : Imf::OStream(path.c_str()), out_(path, std::ios::binary | std::ios::trunc) {}
  void write(const char c[], int n) override {
    out_.write(c, n);
    if (!out_) throw std::runtime_error(Failed());
  }
  uint64_t tellp() override { return static_cast<uint64_t>(std::streamoff(out_.tellp())); }
  void seekp(uint64_t pos) override { out_.seekp(static_cast<std::streamoff>(pos)); }
  // After the file that writes here is gone.
  Status Finish() {
    out_.close();
    return out_ ? OkStatus() : Unavailable("{}", Failed());
  }

 private:
  static std::string Failed() {
    return errno != 0 ? std::strerror(errno) : "writing failed";
  }
  std::ofstream out_;
};

Status WriteParts(const std::filesystem::path& path, int display_width, int display_height,
                  const std::vector<PartToWrite>& parts, const FillChannel& fill) {
  std::vector<Imf::Header> headers;
  for (const PartToWrite& part : parts) {
    headers.push_back(FinishedHeader(part, display_width, display_height));
  }
  CheckedStream stream(path);
  {
    Imf::MultiPartOutputFile file(stream, headers.data(), static_cast<int>(headers.size()),
                                  /*overrideSharedAttributes=*/false, Imf::globalThreadCount());
    for (size_t i = 0; i < parts.size(); ++i) {
      MESORIG_RETURN_IF_ERROR(WritePart(file, i, parts[i], fill));
    }
  }
  return stream.Finish();
}

}  // namespace

Status WriteExr(const std::filesystem::path& path, int display_width, int display_height,
                std::vector<PartToWrite> parts, const FillChannel& fill) {
  StartThreads();
  MESORIG_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
  try {
    const Status status =
        WriteParts(file.temporary_path(), display_width, display_height, parts, fill);
    if (!status.ok()) return Annotate(status, path.string());
  } catch (const std::exception& error) {
    return Unavailable("{}: cannot be written: {}", path.string(), OneLine(error.what()));
  }
  return file.Commit();
}

}  // namespace mesorig::btf
