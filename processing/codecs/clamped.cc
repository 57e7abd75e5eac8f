#include "processing/codecs/clamped.h"

#include <algorithm>

#include "protocol/base/check.h"

namespace mesorig::codecs {
namespace {

// Behind a decoder whose DecodeBtf has become DecodeSigned.
constexpr std::string_view kDecoder = "vec3 DecodeBtf(", kSigned = "vec3 DecodeSigned(";
constexpr std::string_view kClamp = R"glsl(
vec3 DecodeBtf(vec2 uv, float level, ivec3 v, ivec3 l, mat3 pairs) {
  return max(DecodeSigned(uv, level, v, l, pairs), vec3(0.0));
}
)glsl";

void Clamp(std::span<float> values) {
  for (float& x : values) x = std::max(x, 0.0f);
}

class ClampedBtf final : public EncodedBtf {
 public:
  explicit ClampedBtf(std::unique_ptr<EncodedBtf> encoded)
      : encoded_(std::move(encoded)), info_(encoded_->info()) {
    info_.clamp_negative = true;
  }
  const btf::BtfFileInfo& info() const override { return info_; }
  const EncodedBtf& before_clamping() const override { return *encoded_; }
  void DecodeImage(int view, int light, std::span<float> rgb) const override {
    encoded_->DecodeImage(view, light, rgb);
    Clamp(rgb);
  }
  std::array<float, 3> Evaluate(int x, int y, Vec3 v, Vec3 l) const override {
    std::array<float, 3> rgb = encoded_->Evaluate(x, y, v, l);
    Clamp(rgb);
    return rgb;
  }
  void EvaluateBatch(std::span<const SampleQuery> queries,
                     std::span<std::array<float, 3>> out) const override {
    encoded_->EvaluateBatch(queries, out);
    for (std::array<float, 3>& rgb : out) Clamp(rgb);
  }
  void DecodeSamples(std::span<const NodeQuery> queries,
                     std::span<std::array<float, 3>> out) const override {
    encoded_->DecodeSamples(queries, out);
    for (std::array<float, 3>& rgb : out) Clamp(rgb);
  }
  Status PredictImage(int view, Vec3 l, std::span<float> rgb) const override {
    MESORIG_RETURN_IF_ERROR(encoded_->PredictImage(view, l, rgb));
    Clamp(rgb);
    return OkStatus();
  }
  std::vector<btf::Plane> Planes() const override { return encoded_->Planes(); }
  std::optional<ShaderForm> ToShader() const override {
    std::optional<ShaderForm> form = encoded_->ToShader();
    if (!form) return form;
    const size_t at = form->glsl.find(kDecoder);
    MESORIG_CHECK(at != std::string::npos);
    form->glsl.replace(at, kDecoder.size(), kSigned);
    form->glsl += kClamp;
    return form;
  }

 private:
  std::unique_ptr<EncodedBtf> encoded_;
  btf::BtfFileInfo info_;
};

}  // namespace

std::unique_ptr<EncodedBtf> Clamped(std::unique_ptr<EncodedBtf> encoded) {
  return std::make_unique<ClampedBtf>(std::move(encoded));
}

}  // namespace mesorig::codecs
