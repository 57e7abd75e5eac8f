#include <cmath>

#include "processing/codecs/codec.h"

namespace mesorig::codecs {

void EncodedBtf::DecodeSamples(std::span<const NodeQuery> queries,
                               std::span<std::array<float, 3>> out) const {
  const btf::BtfHeader& h = info().header;
  for (size_t i = 0; i < queries.size(); ++i) {
    const auto& [x, y, view, light] = queries[i];
    out[i] = Evaluate(x, y, h.views[static_cast<size_t>(view)], h.lights[static_cast<size_t>(light)]);
  }
}

void EncodedBtf::EvaluateBatch(std::span<const SampleQuery> queries,
                               std::span<std::array<float, 3>> out) const {
  for (size_t i = 0; i < queries.size(); ++i) {
    out[i] = Evaluate(queries[i].x, queries[i].y, queries[i].v, queries[i].l);
  }
}

Status EncodedBtf::PredictImage(int, Vec3, std::span<float>) const {
  return Unimplemented("codec {} cannot predict light directions that were not measured",
                       info().codec);
}

StatusOr<btf::Plane> TakePlane(btf::CodedBtf& file, const std::string& name, int width, int height,
                               const std::vector<std::string>& channels) {
  const auto at = file.planes.find(name);
  if (at == file.planes.end()) return InvalidArgument("part {} is missing", name);
  btf::Plane plane = std::move(at->second);
  file.planes.erase(at);
  if (plane.width != width || plane.height != height) {
    return InvalidArgument("part {} has {} x {} pixels, {} x {} are expected", name, plane.width,
                           plane.height, width, height);
  }
  if (plane.channels != channels) {
    return InvalidArgument("part {} has {} channels, not the {} that are expected", name,
                           plane.channels.size(), channels.size());
  }
  return plane;
}

Status CheckMagnitudes(const btf::Plane& plane, double largest) {
  for (const float x : plane.values) {
    if (!(std::abs(x) <= largest)) {
      return InvalidArgument("part {} holds {:g}, permitted are {:g} to {:g}", plane.name, x,
                             -largest, largest);
    }
  }
  return OkStatus();
}

}  // namespace mesorig::codecs
