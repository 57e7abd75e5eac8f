#include "processing/btf/btf_attributes.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDoubleAttribute.h>
#include <OpenEXR/ImfFloatVectorAttribute.h>
#include <OpenEXR/ImfIntAttribute.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace mesorig::btf {
namespace {

constexpr char kFormat[] = "mesorig-btf";
constexpr size_t kMaxText = 1u << 20;

std::vector<float> Flat(const std::vector<Vec3>& points) {
  std::vector<float> flat;
  for (const Vec3& p : points) {
    flat.insert(flat.end(),
                {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
  }
  return flat;
}

// Reads attributes by name and type, and keeps the first failure.
class Getter {
 public:
  Getter(const Imf::Header& header, const std::string& file) : header_(header), file_(file) {}
  template <typename Attribute, typename T>
  void Get(const char* name, T& value) {
    const auto* attribute = header_.findTypedAttribute<Attribute>(name);
    if (attribute != nullptr) {
      value = attribute->value();
    } else if (status_.ok()) {
      status_ = InvalidArgument("{}: attribute {} is missing or has another type", file_, name);
    }
  }
  void GetFlag(const char* name, bool& value) {
    int number = 0;
    Get<Imf::IntAttribute>(name, number);
    value = number != 0;
  }
  void GetPoints(const char* name, std::vector<Vec3>& points) {
    std::vector<float> flat;
    Get<Imf::FloatVectorAttribute>(name, flat);
    if (flat.size() % 3 != 0 && status_.ok()) {
      status_ = InvalidArgument("{}: attribute {} has {} numbers, not three a point", file_, name,
                                flat.size());
    }
    for (size_t i = 0; i + 2 < flat.size(); i += 3) {
      points.push_back({flat[i], flat[i + 1], flat[i + 2]});
    }
  }
  const Status& status() const { return status_; }

 private:
  const Imf::Header& header_;
  const std::string& file_;
  Status status_;
};

Status CheckText(std::string_view what, const std::string& text, bool json) {
  if (text.size() > kMaxText) {
    return InvalidArgument("{} has {} bytes, at most {} are permitted", what, text.size(),
                           kMaxText);
  }
  if (json && !nlohmann::json::accept(text)) return InvalidArgument("{} is not JSON", what);
  return OkStatus();
}

}  // namespace

Status CheckInfo(const BtfFileInfo& info) {
  MESORIG_RETURN_IF_ERROR(CheckHeader(info.header));
  const size_t pairs = info.header.views.size() * info.header.lights.size();
  if (info.present.size() != pairs) {
    return InvalidArgument("presence of {} pairs for {} views x {} lights", info.present.size(),
                           info.header.views.size(), info.header.lights.size());
  }
  if (!std::isfinite(info.value_scale) || info.value_scale <= 0) {
    return InvalidArgument("value scale {} is not a finite number > 0", info.value_scale);
  }
  if (info.codec.empty() || info.codec.size() > 64) {
    return InvalidArgument("codec name of {} bytes, permitted are 1 to 64", info.codec.size());
  }
  MESORIG_RETURN_IF_ERROR(CheckText("primaries", info.header.primaries, false));
  MESORIG_RETURN_IF_ERROR(CheckText("provenance", info.header.provenance_json, true));
  return CheckText("codec options", info.codec_options_json, true);
}

void PutAttributes(const BtfFileInfo& info, Imf::Header& header) {
  const auto text = [&](const char* name, const std::string& value) {
    header.insert(name, Imf::StringAttribute(value));
  };
  const auto number = [&](const char* name, int value) {
    header.insert(name, Imf::IntAttribute(value));
  };
  const auto real = [&](const char* name, double value) {
    header.insert(name, Imf::DoubleAttribute(value));
  };
  const auto points = [&](const char* name, const std::vector<Vec3>& value) {
    header.insert(name, Imf::FloatVectorAttribute(Flat(value)));
  };
  const BtfHeader& h = info.header;
  text("format", kFormat);
  number("formatMajor", kFormatMajor);
  number("formatMinor", kFormatMinor);
  text("codec", info.codec);
  number("codecVersion", info.codec_version);
  text("codecOptions", info.codec_options_json);
  number("btfWidth", h.width);
  number("btfHeight", h.height);
  real("pitchMm", h.pitch_mm);
  real("hRefMm", h.h_ref_mm);
  points("views", h.views);
  points("lights", h.lights);
  points("viewPositionsMm", h.view_positions_mm);
  points("lightPositionsMm", h.light_positions_mm);
  number("cosineIncluded", h.cosine_included ? 1 : 0);
  number("calibrated", h.calibrated ? 1 : 0);
  text("primaries", h.primaries);
  text("provenance", h.provenance_json);
  real("valueScale", info.value_scale);
  std::string presence(info.present.size(), '0');
  for (size_t i = 0; i < presence.size(); ++i) {
    if (info.present[i] != 0) presence[i] = '1';
  }
  text("presence", presence);
}

StatusOr<BtfFileInfo> GetAttributes(const Imf::Header& header, const std::string& file) {
  const auto* format = header.findTypedAttribute<Imf::StringAttribute>("format");
  if (format == nullptr || format->value() != kFormat) {
    return InvalidArgument("{}: an EXR file, but not a BTF of mesorig", file);
  }
  Getter get(header, file);
  int major = 0;
  get.Get<Imf::IntAttribute>("formatMajor", major);
  if (get.status().ok() && (major > kFormatMajor || major < 1)) {
    return InvalidArgument("{}: format version {}, this program reads up to {}", file, major,
                           kFormatMajor);
  }
  BtfFileInfo info;
  BtfHeader& h = info.header;
  std::string presence;
  get.Get<Imf::StringAttribute>("codec", info.codec);
  get.Get<Imf::IntAttribute>("codecVersion", info.codec_version);
  get.Get<Imf::StringAttribute>("codecOptions", info.codec_options_json);
  get.Get<Imf::IntAttribute>("btfWidth", h.width);
  get.Get<Imf::IntAttribute>("btfHeight", h.height);
  get.Get<Imf::DoubleAttribute>("pitchMm", h.pitch_mm);
  get.Get<Imf::DoubleAttribute>("hRefMm", h.h_ref_mm);
  get.GetPoints("views", h.views);
  get.GetPoints("lights", h.lights);
  get.GetPoints("viewPositionsMm", h.view_positions_mm);
  get.GetPoints("lightPositionsMm", h.light_positions_mm);
  get.GetFlag("cosineIncluded", h.cosine_included);
  get.GetFlag("calibrated", h.calibrated);
  get.Get<Imf::StringAttribute>("primaries", h.primaries);
  get.Get<Imf::StringAttribute>("provenance", h.provenance_json);
  get.Get<Imf::DoubleAttribute>("valueScale", info.value_scale);
  get.Get<Imf::StringAttribute>("presence", presence);
  MESORIG_RETURN_IF_ERROR(get.status());
  for (const char flag : presence) {
    if (flag != '0' && flag != '1') {
      return InvalidArgument("{}: attribute presence holds something else than 0 and 1", file);
    }
    info.present.push_back(flag == '1' ? 1 : 0);
  }
  const Status status = CheckInfo(info);
  if (!status.ok()) return Annotate(status, file);
  return info;
}

bool HasMask(const Imf::Header& header) {
  return header.channels().findChannel("mask") != nullptr;
}

}  // namespace mesorig::btf
