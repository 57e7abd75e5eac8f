#include "processing/btf/btf_strips.h"

#include <OpenEXR/ImfChannelList.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <optional>

#include "processing/btf/exr_attributes.h"
#include "processing/btf/exr_file.h"

namespace mesorig::btf {

struct BtfStrips::File {
  BtfFileInfo info;
  ExrReader reader;
  std::vector<int> parts;  // of each view; -1 where it has none
  bool variance = false;
  std::mutex reading;
};

BtfStrips::BtfStrips(std::unique_ptr<File> file) : file_(std::move(file)) {}
BtfStrips::BtfStrips(BtfStrips&&) noexcept = default;
BtfStrips& BtfStrips::operator=(BtfStrips&&) noexcept = default;
BtfStrips::~BtfStrips() = default;

const BtfFileInfo& BtfStrips::info() const { return file_->info; }

StatusOr<BtfStrips> BtfStrips::Open(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(BtfFileInfo info, ReadBtfInfo(path));
  if (info.codec != "raw") {
    return InvalidArgument("{}: is compressed by codec {}, an uncompressed BTF is expected",
                           path.string(), info.codec);
  }
  MESORIG_ASSIGN_OR_RETURN(ExrReader reader, ExrReader::Open(path));
  MESORIG_ASSIGN_OR_RETURN(const auto named, reader.PartsByName());
  std::vector<int> parts(info.header.views.size(), -1);
  std::optional<bool> variance;  // the first part says whether there are any
  const size_t lights = info.header.lights.size();
  for (size_t pair = 0; pair < info.present.size(); ++pair) {
    if (info.present[pair] == 0 || parts[pair / lights] >= 0) continue;
    const auto part = named.find(ViewPart(static_cast<int>(pair / lights)));
    if (part == named.end()) {
      return InvalidArgument("{}: part {} is missing", path.string(),
                             ViewPart(static_cast<int>(pair / lights)));
    }
    int width = 0, height = 0;
    MESORIG_RETURN_IF_ERROR(reader.PartSize(part->second, width, height));
    if (width != info.header.width || height != info.header.height) {
      return InvalidArgument("{}: part {} has {} x {} pixels, the BTF has {} x {}", path.string(),
                             part->first, width, height, info.header.width, info.header.height);
    }
    parts[pair / lights] = part->second;
    if (!variance) {
      const std::string channel = VarianceChannel(static_cast<int>(pair % lights));
      variance = reader.header(part->second).channels().findChannel(channel) != nullptr;
    }
  }
  return BtfStrips(std::unique_ptr<File>(new File{
      std::move(info), std::move(reader), std::move(parts), variance.value_or(false), {}}));
}

bool BtfStrips::has_variance() const { return file_->variance; }

Status BtfStrips::ReadChannels(int64_t first, int64_t count, std::span<const size_t> pairs,
                               size_t channels,
                               const std::function<std::string(int, size_t)>& name,
                               float* out) const {
  const BtfHeader& h = file_->info.header;
  const int64_t width = h.width, texels = width * h.height;
  if (first < 0 || count < 0 || first > texels || count > texels - first) {
    return InvalidArgument("{}: texels {} to {}, permitted are 0 to {}", file_->reader.name(), first,
                           first + count - 1, texels - 1);
  }
  if (count == 0) return OkStatus();
  const int64_t row = first / width, rows = (first + count - 1) / width - row + 1;
  const bool whole = count == rows * width;
  std::vector<float> strip;  // of one view, where `out` has no room for whole rows
  const std::lock_guard<std::mutex> lock(file_->reading);
  for (size_t begin = 0; begin < pairs.size();) {
    const size_t view = pairs[begin] / h.lights.size();
    size_t end = begin;
    while (end < pairs.size() && pairs[end] / h.lights.size() == view) ++end;
    const size_t columns = (end - begin) * channels;
    float* const to = out + begin * channels * static_cast<size_t>(count);
    if (!whole) strip.resize(columns * static_cast<size_t>(rows * width));
    std::vector<Slice<float>> slices;
    for (size_t i = 0; i < columns; ++i) {
      slices.push_back({name(static_cast<int>(pairs[begin + i / channels] % h.lights.size()), i % channels),
                        (whole ? to : strip.data()) + i * static_cast<size_t>(rows * width), 1, width});
    }
    MESORIG_RETURN_IF_ERROR(file_->reader.ReadRows(file_->parts[view], static_cast<int>(row),
                                                   static_cast<int>(rows), slices));
    for (size_t i = 0; i < columns && !whole; ++i) {
      std::copy_n(slices[i].first + (first - row * width), count, to + i * static_cast<size_t>(count));
    }
    begin = end;
  }
  return OkStatus();
}

Status BtfStrips::Read(int64_t first, int64_t count, std::span<const size_t> pairs,
                       float* out) const {
  MESORIG_RETURN_IF_ERROR(ReadChannels(first, count, pairs, 3, LightChannel, out));
  const auto scale = static_cast<float>(file_->info.value_scale);
  const size_t texels = static_cast<size_t>(count), lights = file_->info.header.lights.size();
  for (size_t i = 0; i < 3 * pairs.size() * texels; ++i) {
    out[i] *= scale;
    if (!std::isfinite(out[i])) {
      const size_t pair = pairs[i / texels / 3];
      return InvalidArgument("{}: view {}, light {} holds a value that is not finite",
                             file_->reader.name(), pair / lights, pair % lights);
    }
  }
  return OkStatus();
}

Status BtfStrips::ReadVariance(int64_t first, int64_t count, std::span<const size_t> pairs,
                               float* out) const {
  if (!has_variance()) return InvalidArgument("{}: has no variances", file_->reader.name());
  MESORIG_RETURN_IF_ERROR(ReadChannels(
      first, count, pairs, 1, [](int light, size_t) { return VarianceChannel(light); }, out));
  const size_t texels = static_cast<size_t>(count);
  for (size_t i = 0; i < pairs.size() * texels; ++i) {
    const size_t lights = file_->info.header.lights.size(), pair = pairs[i / texels];
    MESORIG_RETURN_IF_ERROR(CheckVariance(out[i], pair / lights, pair % lights, file_->reader.name()));
  }
  return OkStatus();
}

}  // namespace mesorig::btf
