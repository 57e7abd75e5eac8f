#pragma once
// Internal to processing/btf: what the attributes of part 0 of `*.btf.exr` and `*.mdf.exr` have in
// common. Nothing here throws on hostile input.

#include <OpenEXR/ImfHeader.h>

#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"

namespace mesorig::btf {

// Attribute `format`.
inline constexpr char kBtfFormat[] = "mesorig-btf", kMdfFormat[] = "mesorig-mdf";

// The part of a view: V000, V001, ...
std::string ViewPart(int view);
// Its channel of a light: L000.R, ...; rgb 0 to 2.
std::string LightChannel(int light, size_t rgb);
std::string VarianceChannel(int light);
// InvalidArgument unless it is finite and not negative.
Status CheckVariance(float variance, size_t view, size_t light, const std::string& file);

// Puts attributes into a header (borrowed).
class AttributeWriter {
 public:
  explicit AttributeWriter(Imf::Header& header) : header_(header) {}
  void Text(const char* name, const std::string& value);
  void Number(const char* name, int value);
  void Flag(const char* name, bool value) { Number(name, value ? 1 : 0); }
  void Real(const char* name, double value);
  void Points(const char* name, const std::vector<Vec3>& value);  // flat: x y z x y z ...

 private:
  Imf::Header& header_;
};

// Reads attributes by name and type, and keeps the first failure: InvalidArgument that names `file`
// and the attribute. What is missing leaves its value as it was. Both arguments are borrowed.
class AttributeReader {
 public:
  AttributeReader(const Imf::Header& header, const std::string& file)
      : header_(header), file_(file) {}
  // That attribute `format` is `expected` and the major version one that is known.
  void Format(std::string_view expected, int known_major);
  void Text(const char* name, std::string& value);
  void Number(const char* name, int& value);
  void Flag(const char* name, bool& value);
  void Real(const char* name, double& value);
  void Points(const char* name, std::vector<Vec3>& points);
  const Status& status() const { return status_; }

 private:
  template <typename Attribute, typename T>
  void Get(const char* name, T& value);

  const Imf::Header& header_;
  const std::string& file_;
  Status status_;
};

// Attribute `format`, "" when there is none.
std::string FormatOf(const Imf::Header& header);
// InvalidArgument when it is longer than a megabyte or, where `json`, is not JSON.
Status CheckText(std::string_view what, const std::string& text, bool json);

}  // namespace mesorig::btf
