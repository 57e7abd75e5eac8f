#include "processing/btf/btf_strips.h"

#include <cmath>
#include <mutex>

#include "processing/btf/exr_attributes.h"
#include "processing/btf/exr_file.h"

namespace mesorig::btf {

struct BtfStrips::File {
  BtfFileInfo info;
  ExrReader reader;
  std::vector<int> parts;  // of each view; -1 where it has none
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
  }
  return BtfStrips(std::unique_ptr<File>(
      new File{std::move(info), std::move(reader), std::move(parts), {}}));
}

Status BtfStrips::Read(int row, int rows, std::span<const size_t> pairs, float* out) const {
  const size_t lights = file_->info.header.lights.size();
  const auto width = static_cast<std::ptrdiff_t>(file_->info.header.width);
  const size_t texels = static_cast<size_t>(rows) * static_cast<size_t>(width);
  const std::lock_guard<std::mutex> lock(file_->reading);
  for (size_t first = 0; first < pairs.size();) {
    const size_t view = pairs[first] / lights;
    std::vector<Slice<float>> slices;
    size_t i = first;
    for (; i < pairs.size() && pairs[i] / lights == view; ++i) {
      for (size_t c = 0; c < 3; ++c) {
        slices.push_back({LightChannel(static_cast<int>(pairs[i] % lights), c),
                          out + (3 * i + c) * texels, 1, width});
      }
    }
    MESORIG_RETURN_IF_ERROR(file_->reader.ReadRows(file_->parts[view], row, rows, slices));
    first = i;
  }
  const auto scale = static_cast<float>(file_->info.value_scale);
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

}  // namespace mesorig::btf
