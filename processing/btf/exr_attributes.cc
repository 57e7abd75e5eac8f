#include "processing/btf/exr_attributes.h"

#include <OpenEXR/ImfDoubleAttribute.h>
#include <OpenEXR/ImfFloatVectorAttribute.h>
#include <OpenEXR/ImfIntAttribute.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace mesorig::btf {
namespace {

constexpr size_t kMaxText = 1u << 20;

}  // namespace

std::string ViewPart(int view) { return fmt::format("V{:03}", view); }
std::string LightChannel(int light, size_t rgb) {
  return fmt::format("L{:03}.{}", light, "RGB"[rgb]);
}

std::string VarianceChannel(int light) { return fmt::format("L{:03}.V", light); }

Status CheckVariance(float variance, size_t view, size_t light, const std::string& file) {
  if (variance >= 0 && std::isfinite(variance)) return OkStatus();
  return InvalidArgument("{}: view {}, light {} holds a variance of {}, which is none", file, view,
                         light, variance);
}

void AttributeWriter::Text(const char* name, const std::string& value) {
  header_.insert(name, Imf::StringAttribute(value));
}
void AttributeWriter::Number(const char* name, int value) {
  header_.insert(name, Imf::IntAttribute(value));
}
void AttributeWriter::Real(const char* name, double value) {
  header_.insert(name, Imf::DoubleAttribute(value));
}
void AttributeWriter::Points(const char* name, const std::vector<Vec3>& value) {
  std::vector<float> flat;
  for (const Vec3& p : value) {
    flat.insert(flat.end(),
                {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
  }
  header_.insert(name, Imf::FloatVectorAttribute(flat));
}

template <typename Attribute, typename T>
void AttributeReader::Get(const char* name, T& value) {
  const auto* attribute = header_.findTypedAttribute<Attribute>(name);
  if (attribute != nullptr) {
    value = attribute->value();
  } else if (status_.ok()) {
    status_ = InvalidArgument("{}: attribute {} is missing or has another type", file_, name);
  }
}

void AttributeReader::Format(std::string_view expected, int known_major) {
  if (!status_.ok()) return;
  if (const std::string format = FormatOf(header_); format != expected) {
    const bool ours = format == kBtfFormat || format == kMdfFormat;
    status_ = InvalidArgument("{}: an EXR file, but not a {}{}", file_, expected,
                              ours ? fmt::format(": it is a {}", format) : "");
    return;
  }
  int major = 0;
  Number("formatMajor", major);
  if (status_.ok() && (major > known_major || major < 1)) {
    status_ = InvalidArgument("{}: format version {}, this program reads up to {}", file_, major,
                              known_major);
  }
}

void AttributeReader::Text(const char* name, std::string& value) {
  Get<Imf::StringAttribute>(name, value);
}
void AttributeReader::Number(const char* name, int& value) { Get<Imf::IntAttribute>(name, value); }
void AttributeReader::Flag(const char* name, bool& value) {
  int number = value ? 1 : 0;
  Number(name, number);
  value = number != 0;
}
void AttributeReader::Real(const char* name, double& value) {
  Get<Imf::DoubleAttribute>(name, value);
}

void AttributeReader::Points(const char* name, std::vector<Vec3>& points) {
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

std::string FormatOf(const Imf::Header& header) {
  const auto* format = header.findTypedAttribute<Imf::StringAttribute>("format");
  return format == nullptr ? std::string() : format->value();
}

Status CheckText(std::string_view what, const std::string& text, bool json) {
  if (text.size() > kMaxText) {
    return InvalidArgument("{} has {} bytes, at most {} are permitted", what, text.size(),
                           kMaxText);
  }
  if (json && !nlohmann::json::accept(text)) return InvalidArgument("{} is not JSON", what);
  return OkStatus();
}

}  // namespace mesorig::btf
