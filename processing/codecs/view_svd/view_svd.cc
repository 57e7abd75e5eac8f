#include "processing/codecs/view_svd/view_svd.h"

#include <algorithm>

namespace mesorig::codecs::view_svd {
namespace {

std::string TermPart(int term) { return fmt::format("G{:03}", term); }

// Sorted by name, as planes are when read: B, G, R.
std::vector<std::string> LightChannels(int lights) {
  std::vector<std::string> channels;
  for (int l = 0; l < lights; ++l) {
    for (const char* rgb : {"B", "G", "R"}) channels.push_back(fmt::format("L{:05}.{}", l, rgb));
  }
  return channels;
}

}  // namespace

StatusOr<std::unique_ptr<ViewSvdBtf>> ViewSvdBtf::Create(btf::BtfFileInfo info, int terms,
                                                         Quantisation quantisation,
                                                         std::vector<float> weights,
                                                         std::vector<float> eigen_textures) {
  MESORIG_ASSIGN_OR_RETURN(btf::PairInterpolator interpolator,
                           btf::PairInterpolator::Build(info.header, info.present));
  return std::unique_ptr<ViewSvdBtf>(new ViewSvdBtf(std::move(info), terms, quantisation,
                                                    std::move(weights), std::move(eigen_textures),
                                                    std::move(interpolator)));
}

void ViewSvdBtf::DecodeImage(int view, int light, std::span<float> rgb) const {
  std::fill(rgb.begin(), rgb.end(), 0.0f);
  for (int k = 0; k < terms_; ++k) {
    const float weight = weights_[static_cast<size_t>(view * terms_ + k)];
    const auto texture = EigenTexture(light, k);
    for (size_t i = 0; i < rgb.size(); ++i) rgb[i] += weight * texture[i];
  }
}

std::array<float, 3> ViewSvdBtf::Evaluate(int x, int y, Vec3 v, Vec3 l) const {
  const btf::PairWeights pairs = interpolator_.Lookup(v, l);
  const size_t at = 3 * (static_cast<size_t>(y) * static_cast<size_t>(info_.header.width) +
                         static_cast<size_t>(x));
  std::array<float, 3> rgb{};
  for (size_t n = 0; n < static_cast<size_t>(pairs.count); ++n) {
    for (int k = 0; k < terms_; ++k) {
      const float weight = pairs.scale * pairs.weight[n] *
                           weights_[static_cast<size_t>(pairs.view[n] * terms_ + k)];
      const auto texture = EigenTexture(pairs.light[n], k);
      for (size_t c = 0; c < 3; ++c) rgb[c] += weight * texture[at + c];
    }
  }
  return rgb;
}

std::vector<btf::Plane> ViewSvdBtf::Planes() const {
  const btf::BtfHeader& h = info_.header;
  std::vector<btf::Plane> planes;
  planes.push_back({"E", terms_, h.view_count(), {"E"}, false, weights_});
  for (int k = 0; k < terms_; ++k) {
    std::vector<float> values;
    for (int l = 0; l < h.light_count(); ++l) {
      const auto texture = EigenTexture(l, k);
      for (size_t c = 3; c-- > 0;) {
        for (size_t i = c; i < texture.size(); i += 3) values.push_back(texture[i]);
      }
    }
    planes.push_back(QuantisedPlane(TermPart(k), h.width, h.height, LightChannels(h.light_count()),
                                    quantisation_, std::move(values)));
  }
  return planes;
}

std::optional<ShaderForm> ViewSvdBtf::ToShader() const {
  static constexpr std::string_view kDecode =
#include "processing/codecs/view_svd/decode_glsl.inc"
      ;
  ShaderForm form;
  form.layers = terms_ * info_.header.light_count();
  form.rgb = eigen_textures_;
  form.table = weights_;
  form.columns = terms_;
  form.glsl = kDecode;
  return form;
}

namespace {

constexpr double kLargestWeight = 0x1p104;  // what Balance makes of the largest float, and some more

class ViewSvdDecoder final : public Decoder {
 public:
  std::string_view name() const override { return kName; }
  std::string_view paper() const override { return "Wang et al. 2005, Sec. 5"; }
  int version() const override { return kVersion; }
  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    const btf::BtfHeader& h = file.info.header;
    const int terms = static_cast<int>(file.planes.size()) - 1;
    if (terms < 1 || terms > h.view_count()) {
      return InvalidArgument("{} terms, permitted are 1 to {} (views)", terms, h.view_count());
    }
    MESORIG_ASSIGN_OR_RETURN(btf::Plane e, TakePlane(file, "E", terms, h.view_count(), {"E"}));
    MESORIG_RETURN_IF_ERROR(CheckMagnitudes(e, kLargestWeight));
    const size_t texels = h.texel_count(), layers = static_cast<size_t>(terms) * h.lights.size();
    std::vector<float> eigen_textures;
    Quantisation quantisation = Quantisation::kHalf;
    const std::vector<std::string> channels = LightChannels(h.light_count());
    for (int k = 0; k < terms; ++k) {
      MESORIG_ASSIGN_OR_RETURN(btf::Plane plane,
                               TakePlane(file, TermPart(k), h.width, h.height, channels));
      eigen_textures.resize(layers * texels * 3);  // only now: the first plane proves the size
      MESORIG_ASSIGN_OR_RETURN(const std::vector<float> values,
                               Dequantised(std::move(plane), quantisation));
      for (size_t l = 0; l < h.lights.size(); ++l) {
        float* const layer = eigen_textures.data() +
                             (l * static_cast<size_t>(terms) + static_cast<size_t>(k)) * texels * 3;
        for (size_t c = 0; c < 3; ++c) {
          const float* const from = values.data() + (3 * l + 2 - c) * texels;
          for (size_t i = 0; i < texels; ++i) layer[3 * i + c] = from[i];
        }
      }
    }
    MESORIG_ASSIGN_OR_RETURN(auto encoded,
                             ViewSvdBtf::Create(std::move(file.info), terms, quantisation,
                                                std::move(e.values), std::move(eigen_textures)));
    return std::unique_ptr<EncodedBtf>(std::move(encoded));
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const ViewSvdDecoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::view_svd
