#include "processing/codecs/sample/mean.h"

#include <algorithm>

namespace mesorig::codecs::sample {

float Cosine(const btf::BtfHeader& header, Vec3 l) {
  if (l.z <= 0) return 0;
  return header.cosine_included ? static_cast<float>(Normalized(l).z) : 1.0f;
}

void MeanBtf::DecodeImage(int, int light, std::span<float> rgb) const {
  const float cosine = Cosine(info_.header, info_.header.lights[static_cast<size_t>(light)]);
  std::transform(albedo_.begin(), albedo_.end(), rgb.begin(),
                 [cosine](float a) { return a * cosine; });
}

Status MeanBtf::PredictImage(int, Vec3 l, std::span<float> rgb) const {
  const float cosine = Cosine(info_.header, l);
  std::transform(albedo_.begin(), albedo_.end(), rgb.begin(),
                 [cosine](float a) { return a * cosine; });
  return OkStatus();
}

std::array<float, 3> MeanBtf::Evaluate(int x, int y, Vec3, Vec3 l) const {
  const size_t at = 3 * (static_cast<size_t>(y) * static_cast<size_t>(info_.header.width) +
                         static_cast<size_t>(x));
  const float cosine = Cosine(info_.header, l);
  return {albedo_[at] * cosine, albedo_[at + 1] * cosine, albedo_[at + 2] * cosine};
}

std::vector<btf::Plane> MeanBtf::Planes() const {
  btf::Plane plane{"albedo", info_.header.width, info_.header.height, {"B", "G", "R"}, false, {}};
  for (size_t c = 3; c-- > 0;) {
    for (size_t i = c; i < albedo_.size(); i += 3) plane.values.push_back(albedo_[i]);
  }
  return {plane};
}

namespace {

class MeanDecoder final : public Decoder {
 public:
  std::string_view name() const override { return kName; }
  std::string_view paper() const override { return "Mueller et al. 2004, Sec. 1 (texture map)"; }
  int version() const override { return kVersion; }

  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    const btf::BtfHeader& h = file.info.header;
    MESORIG_ASSIGN_OR_RETURN(const btf::Plane plane,
                             TakePlane(file, "albedo", h.width, h.height, {"B", "G", "R"}));
    const size_t texels = h.texel_count();
    std::vector<float> albedo(3 * texels);
    for (size_t i = 0; i < texels; ++i) {
      for (size_t c = 0; c < 3; ++c) albedo[3 * i + c] = plane.values[(2 - c) * texels + i];
    }
    return std::unique_ptr<EncodedBtf>(new MeanBtf(std::move(file.info), std::move(albedo)));
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const MeanDecoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::sample
