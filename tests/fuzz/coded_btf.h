#pragma once
// A compressed BTF as a fuzz target's bytes: what codecs get of a file once OpenEXR is through with
// it, without the container, so that every input reaches a decoder.

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "processing/btf/btf_file.h"
#include "protocol/base/bytes.h"

namespace mesorig::fuzz {

inline void PutDirections(const std::vector<Vec3>& directions, ByteWriter& out) {
  out.Put(static_cast<uint8_t>(directions.size()));
  for (const Vec3& d : directions) {
    for (const double x : {d.x, d.y, d.z}) out.Put(static_cast<float>(x));
  }
}

inline std::string Pack(const btf::CodedBtf& coded) {
  const btf::BtfHeader& h = coded.info.header;
  ByteWriter out;
  out.PutString(coded.info.codec).Put(static_cast<uint8_t>(coded.info.codec_version));
  out.PutString(coded.info.codec_options_json).Put(coded.info.value_scale);
  out.Put(static_cast<uint8_t>(h.width)).Put(static_cast<uint8_t>(h.height));
  out.Put(static_cast<uint8_t>(h.cosine_included));
  PutDirections(h.views, out);
  PutDirections(h.lights, out);
  for (const uint8_t flag : coded.info.present) out.Put(flag);
  out.Put(static_cast<uint8_t>(coded.planes.size()));
  for (const auto& [name, plane] : coded.planes) {
    out.PutString(name).Put(static_cast<uint16_t>(plane.width));
    out.Put(static_cast<uint16_t>(plane.height));
    out.Put(static_cast<uint8_t>(plane.bytes ? 2 : plane.half ? 1 : 0));
    std::string channels;
    for (const std::string& channel : plane.channels) channels += channel + " ";
    out.PutString(channels);
    for (const float x : plane.values) out.Put(x);
  }
  return out.Take();
}

inline std::vector<Vec3> GetDirections(ByteReader& in) {
  std::vector<Vec3> directions(in.Get<uint8_t>());
  for (Vec3& d : directions) {
    const double x = in.Get<float>(), y = in.Get<float>();
    d = {x, y, in.Get<float>()};
  }
  return directions;
}

// As ReadPlane reads it: values are finite, of bytes whole numbers within 127, channels sorted.
inline std::optional<btf::Plane> GetPlane(ByteReader& in) {
  btf::Plane plane;
  plane.name = in.GetString();
  plane.width = in.Get<uint16_t>(), plane.height = in.Get<uint16_t>();
  const auto kind = in.Get<uint8_t>();
  plane.bytes = kind == 2, plane.half = kind == 1;
  std::string_view channels = in.GetString();
  while (!channels.empty()) {
    const size_t end = channels.find(' ');
    plane.channels.emplace_back(channels.substr(0, end));
    channels.remove_prefix(end == std::string_view::npos ? channels.size() : end + 1);
  }
  std::sort(plane.channels.begin(), plane.channels.end());
  const size_t count = static_cast<size_t>(plane.width) * static_cast<size_t>(plane.height) *
                       plane.channels.size();
  if (!in.ok() || count == 0 || count > in.remaining() / sizeof(float)) return std::nullopt;
  for (size_t i = 0; i < count; ++i) {
    auto x = in.Get<float>();
    if (!std::isfinite(x)) x = 1;
    plane.values.push_back(plane.bytes ? std::clamp(std::round(x), -128.0f, 127.0f) : x);
  }
  return plane;
}

// Nothing for bytes that are no such file, or one that ReadCodedBtf would have refused.
inline std::optional<btf::CodedBtf> Unpack(std::string_view bytes) {
  ByteReader in(bytes);
  btf::CodedBtf coded;
  btf::BtfHeader& h = coded.info.header;
  coded.info.codec = in.GetString();
  coded.info.codec_version = in.Get<uint8_t>();
  coded.info.codec_options_json = in.GetString();
  coded.info.value_scale = in.Get<double>();
  h.width = in.Get<uint8_t>(), h.height = in.Get<uint8_t>();
  h.cosine_included = (in.Get<uint8_t>() & 1) != 0;
  h.views = GetDirections(in);
  h.lights = GetDirections(in);
  for (size_t i = 0; i < h.views.size() * h.lights.size(); ++i) {
    coded.info.present.push_back(in.Get<uint8_t>() & 1);
  }
  const double scale = coded.info.value_scale;
  if (!in.ok() || !btf::CheckHeader(h).ok() || !(scale > 0 && std::isfinite(scale))) {
    return std::nullopt;
  }
  for (size_t planes = in.Get<uint8_t>(); planes > 0; --planes) {
    std::optional<btf::Plane> plane = GetPlane(in);
    if (!plane) return std::nullopt;
    coded.planes.emplace(plane->name, *std::move(plane));
  }
  if (!in.done()) return std::nullopt;
  return coded;
}

}  // namespace mesorig::fuzz
