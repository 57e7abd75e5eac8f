#include "processing/codecs/rf_ptm/rf_ptm.h"

#include <algorithm>

namespace mesorig::codecs::rf_ptm {
namespace {

// Sorted by name, as planes are when read.
std::vector<std::string> Channels() {
  std::vector<std::string> channels;
  for (int a = 0; a < kCoefficients; ++a) {
    for (const char* rgb : {"B", "G", "R"}) channels.push_back(fmt::format("a{}.{}", a, rgb));
  }
  return channels;
}

std::string ViewPart(int view) { return fmt::format("P{:05}", view); }

// The measured direction, or the point of the cone, that stands for l.
Vec3 Nearest(const btf::DirectionInterpolator& lights, const btf::DirectionWeights& chosen) {
  Vec3 sum;
  for (size_t k = 0; k < 3; ++k) {
    sum = sum + chosen.weight[k] * lights.directions()[static_cast<size_t>(chosen.index[k])];
  }
  return Normalized(sum);
}

}  // namespace

std::array<double, kCoefficients> Basis(Vec3 l) {
  return {l.x * l.x, l.y * l.y, l.x * l.y, l.x, l.y, 1.0};
}

StatusOr<std::unique_ptr<RfPtmBtf>> RfPtmBtf::Create(btf::BtfFileInfo info,
                                                     std::vector<float> coefficients) {
  // A view is there with its polynomial, whichever lights it was fitted to.
  std::vector<uint8_t> present = info.present;
  const size_t lights = info.header.lights.size();
  for (size_t v = 0; v < info.header.views.size() && (v + 1) * lights <= present.size(); ++v) {
    const auto first = present.begin() + static_cast<std::ptrdiff_t>(v * lights);
    const auto last = first + static_cast<std::ptrdiff_t>(lights);
    const bool any = std::any_of(first, last, [](uint8_t flag) { return flag != 0; });
    std::fill(first, last, any ? uint8_t{1} : uint8_t{0});
  }
  MESORIG_ASSIGN_OR_RETURN(btf::PairInterpolator interpolator,
                           btf::PairInterpolator::Build(info.header, std::move(present)));
  return std::unique_ptr<RfPtmBtf>(
      new RfPtmBtf(std::move(info), std::move(coefficients), std::move(interpolator)));
}

void RfPtmBtf::Polynomial(int view, Vec3 l, std::span<float> rgb) const {
  const auto basis = Basis(l);
  std::fill(rgb.begin(), rgb.end(), 0.0f);
  for (size_t a = 0; a < kCoefficients; ++a) {
    const auto factor = static_cast<float>(basis[a] * info_.value_scale);
    const float* const from =
        coefficients_.data() + (static_cast<size_t>(view) * kCoefficients + a) * rgb.size();
    for (size_t i = 0; i < rgb.size(); ++i) rgb[i] += factor * from[i];
  }
  for (float& value : rgb) value = std::max(value, 0.0f);
}

void RfPtmBtf::DecodeImage(int view, int light, std::span<float> rgb) const {
  Polynomial(view, info_.header.lights[static_cast<size_t>(light)], rgb);
}

Status RfPtmBtf::PredictImage(int view, Vec3 l, std::span<float> rgb) const {
  Polynomial(view, Normalized(l), rgb);
  return OkStatus();
}

std::array<float, 3> RfPtmBtf::Evaluate(int x, int y, Vec3 v, Vec3 l) const {
  const btf::PairWeights pairs = interpolator_.Lookup(v, l);
  const btf::DirectionInterpolator& lights = interpolator_.lights();
  const btf::DirectionWeights chosen = lights.Lookup(l);
  const auto basis = Basis(Nearest(lights, chosen));
  float scale = l.z > 0 ? 1.0f : 0.0f;
  if (info_.header.cosine_included) {
    scale = static_cast<float>(btf::HorizonScale(lights, chosen, l));
  }
  const size_t image = 3 * info_.header.texel_count();
  const size_t at = 3 * (static_cast<size_t>(y) * static_cast<size_t>(info_.header.width) +
                         static_cast<size_t>(x));
  std::array<float, 3> rgb{};
  for (size_t n = 0; n < static_cast<size_t>(pairs.count); ++n) {
    for (size_t c = 0; c < 3; ++c) {
      double value = 0;
      for (size_t a = 0; a < kCoefficients; ++a) {
        value += basis[a] * coefficients_[(static_cast<size_t>(pairs.view[n]) * kCoefficients + a) *
                                              image + at + c];
      }
      rgb[c] += scale * pairs.weight[n] *
                static_cast<float>(std::max(0.0, value * info_.value_scale));
    }
  }
  return rgb;
}

std::vector<btf::Plane> RfPtmBtf::Planes() const {
  const btf::BtfHeader& h = info_.header;
  const size_t image = 3 * h.texel_count();
  std::vector<btf::Plane> planes;
  for (int v = 0; v < h.view_count(); ++v) {
    btf::Plane plane{ViewPart(v), h.width, h.height, Channels(), true, {}};
    for (size_t a = 0; a < kCoefficients; ++a) {
      const float* const from =
          coefficients_.data() + (static_cast<size_t>(v) * kCoefficients + a) * image;
      for (size_t c = 3; c-- > 0;) {
        for (size_t i = c; i < image; i += 3) plane.values.push_back(from[i]);
      }
    }
    planes.push_back(std::move(plane));
  }
  return planes;
}

namespace {

constexpr double kLargestValue = 1e36;  // of a coefficient; six of them are summed

class RfPtmDecoder final : public Decoder {
 public:
  std::string_view name() const override { return kName; }
  std::string_view paper() const override {
    return "Mueller et al. 2004, Sec. 3.1.3, Eq. 5; Malzbender et al. 2001, Eq. 5";
  }
  int version() const override { return kVersion; }

  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    const btf::BtfHeader& h = file.info.header;
    if (file.planes.size() != h.views.size()) {
      return InvalidArgument("{} parts of polynomials for {} views", file.planes.size(),
                             h.views.size());
    }
    if (file.info.value_scale > kLargestValue) {
      return InvalidArgument("a value scale of {:g}, at most {:g} is permitted",
                             file.info.value_scale, kLargestValue);
    }
    const size_t texels = h.texel_count();
    std::vector<float> coefficients;
    for (int v = 0; v < h.view_count(); ++v) {
      MESORIG_ASSIGN_OR_RETURN(const btf::Plane plane,
                               TakePlane(file, ViewPart(v), h.width, h.height, Channels()));
      MESORIG_RETURN_IF_ERROR(CheckMagnitudes(plane, kLargestValue / file.info.value_scale));
      const size_t first = coefficients.size();
      coefficients.resize(first + plane.values.size());
      for (size_t a = 0; a < kCoefficients; ++a) {
        for (size_t c = 0; c < 3; ++c) {
          const float* const from = plane.values.data() + (3 * a + 2 - c) * texels;
          float* const to = coefficients.data() + first + a * texels * 3 + c;
          for (size_t i = 0; i < texels; ++i) to[3 * i] = from[i];
        }
      }
    }
    MESORIG_ASSIGN_OR_RETURN(auto encoded,
                             RfPtmBtf::Create(std::move(file.info), std::move(coefficients)));
    return std::unique_ptr<EncodedBtf>(std::move(encoded));
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const RfPtmDecoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::rf_ptm
