#include "processing/btf/btf_file.h"

#include <Imath/half.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfIntAttribute.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "processing/btf/btf_attributes.h"
#include "processing/btf/exr_attributes.h"
#include "processing/btf/exr_file.h"

namespace mesorig::btf {
namespace {

// Part 0 of `reader`, mask included.
StatusOr<BtfFileInfo> ReadInfo(const ExrReader& reader) {
  MESORIG_ASSIGN_OR_RETURN(BtfFileInfo info, GetAttributes(reader.header(0), reader.name()));
  info.file_bytes = reader.file_bytes();
  int width = 0, height = 0;
  MESORIG_RETURN_IF_ERROR(reader.PartSize(0, width, height));
  if (width != info.header.width || height != info.header.height) {
    return InvalidArgument("{}: its preview has {} x {} pixels, its attributes say {} x {}",
                           reader.name(), width, height, info.header.width, info.header.height);
  }
  if (HasMask(reader.header(0))) {
    std::vector<float> mask(info.header.texel_count());
    MESORIG_RETURN_IF_ERROR(reader.ReadPart(0, {{"mask", mask.data(), 1, width}}));
    info.header.mask.resize(mask.size());
    std::transform(mask.begin(), mask.end(), info.header.mask.begin(),
                   [](float m) { return static_cast<uint8_t>(m > 0.5f ? 1 : 0); });
  }
  return info;
}

float LargestMagnitude(const SampledBtf& btf) {
  float largest = 0;
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      if (!btf.Present(v, l)) continue;
      for (const float value : btf.Image(v, l)) {
        // Written so that NaN is kept.
        if (!(std::abs(value) <= largest)) largest = std::abs(value);
        if (std::isnan(largest)) return largest;
      }
    }
  }
  return largest;
}

// 1, or the power of two that brings the largest magnitude into [2^11, 2^12].
double ValueScaleFor(float largest) {
  if (largest == 0 || (largest >= 0x1p-6f && largest <= 0x1p12f)) return 1;
  int exponent = 0;
  std::frexp(largest, &exponent);
  return std::ldexp(1.0, std::max(exponent - 12, -120));  // its inverse must be a float
}

std::vector<int> PresentLights(const SampledBtf& btf, int view) {
  std::vector<int> lights;
  for (int l = 0; l < btf.header().light_count(); ++l) {
    if (btf.Present(view, l)) lights.push_back(l);
  }
  return lights;
}

// The preview is scaled so that all but its brightest hundredth fits into [0, 0.9].
float PreviewScale(std::span<const float> preview) {
  std::vector<float> sorted(preview.begin(), preview.end());
  if (sorted.empty()) return 1;
  const auto at = sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() - 1) * 99 / 100);
  std::nth_element(sorted.begin(), at, sorted.end());
  return *at > 0 ? 0.9f / *at : 1.0f;
}

PartToWrite PreviewPart(const BtfFileInfo& info) {
  PartToWrite part;
  part.name = "preview";
  part.width = info.header.width;
  part.height = info.header.height;
  part.channels = {{"R"}, {"G"}, {"B"}};
  if (!info.header.mask.empty()) part.channels.push_back({"mask"});
  PutAttributes(info, part.header);
  return part;
}

FillChannel PreviewFill(const BtfFileInfo& info, std::span<const float> preview) {
  const float scale = PreviewScale(preview);
  return [&info, preview, scale](size_t, size_t channel, std::vector<float>& values) {
    for (size_t i = 0; i < values.size(); ++i) {
      if (channel == 3) {
        values[i] = info.header.mask[i];
      } else if (!preview.empty()) {
        values[i] = std::clamp(preview[3 * i + channel] * scale, 0.0f, 65000.0f);
      }
    }
  };
}

BtfFileInfo RawInfo(const SampledBtf& btf, double value_scale) {
  BtfFileInfo info;
  info.header = btf.header();
  info.codec = "raw";
  info.codec_options_json = "{}";
  info.value_scale = value_scale;
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      info.present.push_back(btf.Present(v, l) ? 1 : 0);
    }
  }
  return info;
}

Status ReadView(const ExrReader& reader, const BtfFileInfo& info, int part, int view,
                SampledBtf& btf) {
  int width = 0, height = 0;
  MESORIG_RETURN_IF_ERROR(reader.PartSize(part, width, height));
  if (width != info.header.width || height != info.header.height) {
    return InvalidArgument("{}: part {} has {} x {} pixels, the BTF has {} x {}", reader.name(),
                           ViewPart(view), width, height, info.header.width, info.header.height);
  }
  std::vector<Slice<float>> slices;
  const std::vector<int> lights = PresentLights(btf, view);
  for (const int l : lights) {
    float* const image = btf.MutableImage(view, l).data();
    for (size_t c = 0; c < 3; ++c) slices.push_back({LightChannel(l, c), image + c, 3, 3 * width});
    if (!btf.has_variance()) continue;
    slices.push_back({VarianceChannel(l), btf.MutableVariance(view, l).data(), 1, width});
  }
  MESORIG_RETURN_IF_ERROR(reader.ReadPart(part, slices));
  const auto scale = static_cast<float>(info.value_scale);
  for (const int l : lights) {
    for (float& value : btf.MutableImage(view, l)) {
      value *= scale;
      if (!std::isfinite(value)) {
        return InvalidArgument("{}: view {}, light {} holds a value that is not finite",
                               reader.name(), view, l);
      }
    }
    if (!btf.has_variance()) continue;
    for (const float variance : btf.Variance(view, l)) {
      MESORIG_RETURN_IF_ERROR(CheckVariance(variance, static_cast<size_t>(view),
                                            static_cast<size_t>(l), reader.name()));
    }
  }
  return OkStatus();
}

// Memory is taken for absent pairs too, which a file need not hold: what it declares must be in some
// proportion to it, or small.
Status CheckDeclared(const BtfFileInfo& info, const std::filesystem::path& path) {
  constexpr double kMostPacked = 2200;  // bytes as float of a byte of the file: deflate's 1032 : 1 of half
  constexpr double kSmallBytes = 256e6;
  const double bytes = 12.0 * static_cast<double>(info.header.texel_count()) *
                       static_cast<double>(info.present.size());
  if (bytes <= std::max(kSmallBytes, kMostPacked * static_cast<double>(info.file_bytes))) {
    return OkStatus();
  }
  return InvalidArgument("{}: declares {:.1f} GB of samples in {} bytes", path.string(),
                         bytes * 1e-9, info.file_bytes);
}

}  // namespace

StatusOr<BtfFileInfo> ReadBtfInfo(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const ExrReader reader, ExrReader::Open(path));
  return ReadInfo(reader);
}

Status WriteSampledBtf(const SampledBtf& btf, const std::filesystem::path& path) {
  const float largest = LargestMagnitude(btf);
  if (!std::isfinite(largest)) {
    return InvalidArgument("{}: the BTF holds a value that is not finite", path.string());
  }
  const BtfFileInfo info = RawInfo(btf, ValueScaleFor(largest));
  const Status valid = CheckInfo(info);
  if (!valid.ok()) return Annotate(valid, path.string());
  std::vector<PartToWrite> parts = {PreviewPart(info)};
  std::vector<std::pair<int, std::vector<int>>> views = {{-1, {}}};  // of each part
  for (int v = 0; v < info.header.view_count(); ++v) {
    const std::vector<int> lights = PresentLights(btf, v);
    if (lights.empty()) continue;
    PartToWrite part;
    part.name = ViewPart(v);
    part.width = info.header.width;
    part.height = info.header.height;
    for (const int l : lights) {
      for (size_t c = 0; c < 3; ++c) part.channels.push_back({LightChannel(l, c)});
      if (btf.has_variance()) part.channels.push_back({VarianceChannel(l), /*half=*/false});
    }
    parts.push_back(std::move(part));
    views.emplace_back(v, lights);
  }
  const auto [view, light] = PreviewPair(info.header, info.present);
  const FillChannel preview = PreviewFill(info, btf.Image(view, light));
  const auto inverse = static_cast<float>(1 / info.value_scale);
  return WriteExr(path, info.header.width, info.header.height, std::move(parts),
                  [&](size_t part, size_t channel, std::vector<float>& values) {
                    if (part == 0) return preview(part, channel, values);
                    const auto& [v, lights] = views[part];
                    const size_t of_light = btf.has_variance() ? 4 : 3;
                    const int light_of = lights[channel / of_light];
                    if (channel % of_light == 3) {
                      const auto variance = btf.Variance(v, light_of);
                      std::copy(variance.begin(), variance.end(), values.begin());
                      return;
                    }
                    const auto image = btf.Image(v, light_of);
                    for (size_t i = 0; i < values.size(); ++i) {
                      values[i] = image[3 * i + channel % of_light] * inverse;
                    }
                  });
}

StatusOr<SampledBtf> ReadSampledBtf(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const ExrReader reader, ExrReader::Open(path));
  MESORIG_ASSIGN_OR_RETURN(const BtfFileInfo info, ReadInfo(reader));
  if (info.codec != "raw") {
    return InvalidArgument("{}: is compressed by codec {}, an uncompressed BTF is expected",
                           path.string(), info.codec);
  }
  MESORIG_ASSIGN_OR_RETURN(const auto parts, reader.PartsByName());
  MESORIG_RETURN_IF_ERROR(CheckDenseMemory(info.header, path));
  MESORIG_RETURN_IF_ERROR(CheckDeclared(info, path));
  SampledBtf btf(info.header);
  bool any_read = false;  // the first part says whether there are variances
  for (int v = 0; v < info.header.view_count(); ++v) {
    bool any = false;
    for (int l = 0; l < info.header.light_count(); ++l) {
      const bool present = info.present[btf.PairIndex(v, l)] != 0;
      btf.SetPresent(v, l, present);
      any = any || present;
    }
    if (!any) continue;
    const auto part = parts.find(ViewPart(v));
    if (part == parts.end()) {
      return InvalidArgument("{}: part {} is missing", path.string(), ViewPart(v));
    }
    const int light = PresentLights(btf, v).front();
    if (!any_read && reader.header(part->second).channels().findChannel(VarianceChannel(light))) {
      btf.AddVariance();
    }
    any_read = true;
    MESORIG_RETURN_IF_ERROR(ReadView(reader, info, part->second, v, btf));
  }
  return btf;
}

namespace {

constexpr int kBytesPerPixel = 4;
constexpr float kLargestByte = 127;
constexpr const char* kByteWidth = "byteWidth";

int PackedWidth(int width) { return (width + kBytesPerPixel - 1) / kBytesPerPixel; }

// The channel of `plane` as bytes, four to a value of `pixels`.
void PackBytes(const Plane& plane, size_t channel, std::vector<float>& pixels) {
  const auto width = static_cast<size_t>(plane.width), height = static_cast<size_t>(plane.height);
  const float* const from = plane.values.data() + channel * width * height;
  auto* const to = reinterpret_cast<char*>(pixels.data());
  const size_t row_bytes = static_cast<size_t>(PackedWidth(plane.width)) * kBytesPerPixel;
  for (size_t y = 0; y < height; ++y) {
    for (size_t x = 0; x < width; ++x) {
      to[y * row_bytes + x] = static_cast<char>(static_cast<int8_t>(from[y * width + x]));
    }
  }
}

Status CheckBytes(const Plane& plane) {
  for (const float x : plane.values) {
    if (!(std::abs(x) <= kLargestByte)) {
      return InvalidArgument("plane {}: {} is no byte, permitted are -127 to 127", plane.name, x);
    }
  }
  return OkStatus();
}

// The part of a plane, without its values.
StatusOr<PartToWrite> PartOf(const Plane& plane) {
  const size_t size = static_cast<size_t>(std::max(plane.width, 0)) *
                      static_cast<size_t>(std::max(plane.height, 0)) * plane.channels.size();
  if (size == 0 || plane.values.size() != size) {
    return InvalidArgument("plane {} has {} values for {} x {} x {} channels", plane.name,
                           plane.values.size(), plane.width, plane.height, plane.channels.size());
  }
  PartToWrite part;
  part.name = plane.name;
  part.width = plane.width;
  part.height = plane.height;
  if (plane.bytes) {
    MESORIG_RETURN_IF_ERROR(CheckBytes(plane));
    part.width = PackedWidth(plane.width);
    part.header.insert(kByteWidth, Imf::IntAttribute(plane.width));
  }
  for (const std::string& channel : plane.channels) {
    part.channels.push_back({channel, plane.half, plane.bytes});
  }
  return part;
}

}  // namespace

Status WriteCodedBtf(const BtfFileInfo& info, const std::vector<Plane>& planes,
                     std::span<const float> preview, const std::filesystem::path& path) {
  const Status valid = CheckInfo(info);
  if (!valid.ok()) return Annotate(valid, path.string());
  if (!preview.empty() && preview.size() != 3 * info.header.texel_count()) {
    return InvalidArgument("{}: a preview of {} values for {} x {} texels", path.string(),
                           preview.size(), info.header.width, info.header.height);
  }
  std::vector<PartToWrite> parts = {PreviewPart(info)};
  for (const Plane& plane : planes) {
    auto part = PartOf(plane);
    if (!part.ok()) return Annotate(part.status(), path.string());
    parts.push_back(*std::move(part));
  }
  const FillChannel fill_preview = PreviewFill(info, preview);
  return WriteExr(path, info.header.width, info.header.height, std::move(parts),
                  [&](size_t part, size_t channel, std::vector<float>& values) {
                    if (part == 0) return fill_preview(part, channel, values);
                    if (planes[part - 1].bytes) return PackBytes(planes[part - 1], channel, values);
                    const float* first =
                        planes[part - 1].values.data() + channel * values.size();
                    std::copy(first, first + values.size(), values.begin());
                  });
}

namespace {

// The values of a part of UINT channels; plane.width is the packed width before, the true one after.
Status ReadBytes(const ExrReader& reader, int part, Plane& plane) {
  const auto* const attribute =
      reader.header(part).findTypedAttribute<Imf::IntAttribute>(kByteWidth);
  const int width = attribute != nullptr ? attribute->value() : 0;
  if (width < 1 || width > (1 << 30) || PackedWidth(width) != plane.width) {
    return InvalidArgument("{}: part {} of bytes has {} pixels a row and {} {}", reader.name(),
                           plane.name, plane.width, kByteWidth, width);
  }
  const size_t height = static_cast<size_t>(plane.height);
  const size_t row = static_cast<size_t>(plane.width), pixels = row * height;
  std::vector<uint32_t> packed(pixels * plane.channels.size());
  std::vector<Slice<uint32_t>> slices;
  for (size_t c = 0; c < plane.channels.size(); ++c) {
    slices.push_back({plane.channels[c], packed.data() + c * pixels, 1, plane.width});
  }
  MESORIG_RETURN_IF_ERROR(reader.ReadPart(part, slices));
  plane.values.reserve(static_cast<size_t>(width) * height * plane.channels.size());
  const auto* const bytes = reinterpret_cast<const int8_t*>(packed.data());
  for (size_t y = 0; y < height * plane.channels.size(); ++y) {
    const int8_t* const first = bytes + y * row * kBytesPerPixel;
    plane.values.insert(plane.values.end(), first, first + width);
  }
  plane.width = width;
  return OkStatus();
}

StatusOr<Plane> ReadPlane(const ExrReader& reader, int part) {
  Plane plane;
  plane.name = reader.PartName(part);
  MESORIG_RETURN_IF_ERROR(reader.PartSize(part, plane.width, plane.height));
  const Imf::ChannelList& channels = reader.header(part).channels();
  plane.half = true;
  for (auto channel = channels.begin(); channel != channels.end(); ++channel) {
    plane.channels.emplace_back(channel.name());
    plane.half = plane.half && channel.channel().type == Imf::HALF;
    if (channel == channels.begin()) plane.bytes = channel.channel().type == Imf::UINT;
    if (plane.bytes != (channel.channel().type == Imf::UINT)) {
      return InvalidArgument("{}: part {} mixes UINT and other channels", reader.name(),
                             plane.name);
    }
  }
  const size_t texels = static_cast<size_t>(plane.width) * static_cast<size_t>(plane.height);
  MESORIG_RETURN_IF_ERROR(
      CheckMemory((plane.bytes ? 20.0 : 4.0) * static_cast<double>(texels) *
                      static_cast<double>(plane.channels.size()),
                  reader.name()));
  if (plane.bytes) {
    MESORIG_RETURN_IF_ERROR(ReadBytes(reader, part, plane));
    return plane;
  }
  plane.values.resize(texels * plane.channels.size());
  std::vector<Slice<float>> slices;
  for (size_t c = 0; c < plane.channels.size(); ++c) {
    slices.push_back({plane.channels[c], plane.values.data() + c * texels, 1, plane.width});
  }
  MESORIG_RETURN_IF_ERROR(reader.ReadPart(part, slices));
  if (!std::all_of(plane.values.begin(), plane.values.end(),
                   [](float value) { return std::isfinite(value); })) {
    return InvalidArgument("{}: part {} holds a value that is not finite", reader.name(),
                           plane.name);
  }
  return plane;
}

}  // namespace

StatusOr<CodedBtf> ReadCodedBtf(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const ExrReader reader, ExrReader::Open(path));
  CodedBtf coded;
  MESORIG_ASSIGN_OR_RETURN(coded.info, ReadInfo(reader));
  MESORIG_ASSIGN_OR_RETURN(const auto parts, reader.PartsByName());
  for (const auto& [name, part] : parts) {
    MESORIG_ASSIGN_OR_RETURN(Plane plane, ReadPlane(reader, part));
    coded.planes.emplace(name, std::move(plane));
  }
  return coded;
}

std::pair<int, int> PreviewPair(const BtfHeader& header, const std::vector<uint8_t>& present) {
  constexpr double kBestLight = 35 * kPi / 180;
  constexpr double kViewWeight = 10;  // the view matters first
  std::pair<int, int> best{0, 0};
  double best_cost = std::numeric_limits<double>::infinity();
  const size_t lights = header.lights.size();
  for (size_t i = 0; i < present.size(); ++i) {
    if (present[i] == 0) continue;
    const double view_theta = AnglesFromDirection(header.views[i / lights]).theta_rad;
    const double light_theta = AnglesFromDirection(header.lights[i % lights]).theta_rad;
    const double cost = kViewWeight * view_theta + std::abs(light_theta - kBestLight);
    if (cost < best_cost) {
      best_cost = cost;
      best = {static_cast<int>(i / lights), static_cast<int>(i % lights)};
    }
  }
  return best;
}

Status CheckDenseMemory(const BtfHeader& header, const std::filesystem::path& path) {
  return CheckMemory(12.0 * static_cast<double>(header.texel_count()) *
                         static_cast<double>(header.views.size() * header.lights.size()),
                     path.string());
}

void RoundToHalf(std::span<float> values) {
  for (float& value : values) value = static_cast<float>(Imath::half(value));
}

uint64_t UncompressedBytes(const BtfHeader& header, const std::vector<uint8_t>& present) {
  const auto pairs = static_cast<uint64_t>(
      std::count_if(present.begin(), present.end(), [](uint8_t flag) { return flag != 0; }));
  return pairs * header.texel_count() * 3 * 2;
}

}  // namespace mesorig::btf
