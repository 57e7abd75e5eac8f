#include "processing/codecs/view_svd/view_svd.h"

#include <algorithm>
#include <cstring>

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

// Four floats as the processor takes them.
using Four = float __attribute__((vector_size(16)));
Four Load(const float* from) {
  Four x;
  std::memcpy(&x, from, sizeof x);
  return x;
}
Four Broadcast(float x) { return Four{x, x, x, x}; }

// sum over terms of weights[k] * texel[k][rgb]; the last of the four is of no meaning.
Four WeightedTerms(const float* weights, const float* texel, size_t terms) {
  Four sum{};
  for (size_t k = 0; k < terms; ++k) sum += Broadcast(weights[k]) * Load(texel + 3 * k);
  return sum;
}

template <size_t kTerms>  // 0: any number
void DecodeTexels(const float* weights, const float* texels, size_t terms, std::span<float> rgb) {
  const size_t n = kTerms == 0 ? terms : kTerms, last = rgb.size() - 3;
  for (size_t i = 0; i < last; i += 3) {
    const Four value = WeightedTerms(weights, texels + i * n, n);
    std::memcpy(rgb.data() + i, &value, sizeof value);  // the fourth is overwritten next
  }
  const Four value = WeightedTerms(weights, texels + last * n, n);
  std::memcpy(rgb.data() + last, &value, 3 * sizeof(float));
}

constexpr size_t kAtOnce = 32, kAhead = 16;  // samples whose factors are on their way from memory

}  // namespace

ViewSvdBtf::ViewSvdBtf(btf::BtfFileInfo info, int terms, Quantisation quantisation,
                       std::vector<float> weights, std::vector<float> eigen_textures,
                       btf::PairInterpolator interpolator)
    : info_(std::move(info)), terms_(terms), quantisation_(quantisation),
      weights_(std::move(weights)), eigen_textures_(std::move(eigen_textures)),
      interpolator_(std::move(interpolator)) {
  eigen_textures_.push_back(0);
}

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
  const auto terms = static_cast<size_t>(terms_);
  const float* const weights = weights_.data() + static_cast<size_t>(view) * terms;
  const float* const texels = EigenTexel(light, 0);
  if (terms_ == kDefaultTerms) return DecodeTexels<kDefaultTerms>(weights, texels, terms, rgb);
  DecodeTexels<0>(weights, texels, terms, rgb);
}

// Those that are not used have weight 0.
struct ViewSvdBtf::Taps {
  std::array<const float*, 3> view{};   // rows of E
  std::array<const float*, 3> texel{};  // of each light
  std::array<float, 3> view_weight{}, light_weight{};
};

bool ViewSvdBtf::TapsOf(const SampleQuery& query, Taps& taps) const {
  btf::SeparateWeights weights;
  if (!interpolator_.LookupSeparate(query.v, query.l, weights)) return false;
  const size_t texel = TexelOf(query);
  for (size_t i = 0; i < 3; ++i) {
    taps.view[i] = weights_.data() + weights.view.index[i] * terms_;
    taps.view_weight[i] = weights.scale * weights.view.weight[i];
    taps.light_weight[i] = weights.light.weight[i];
    // Weight 0 comes with index 0: read what is read anyway.
    taps.texel[i] = weights.light.weight[i] > 0 ? EigenTexel(weights.light.index[i], texel) : nullptr;
  }
  const float* const any = taps.texel[0] != nullptr   ? taps.texel[0]
                           : taps.texel[1] != nullptr ? taps.texel[1]
                                                      : taps.texel[2];
  for (const float*& at : taps.texel) at = at == nullptr ? any : at;
  return true;
}

std::array<float, 3> ViewSvdBtf::Sum(const Taps& taps) const {
  std::array<Four, 3> sums{};
  for (size_t k = 0; k < static_cast<size_t>(terms_); ++k) {
    const Four weight = Broadcast(taps.view_weight[0] * taps.view[0][k] +
                                  taps.view_weight[1] * taps.view[1][k] +
                                  taps.view_weight[2] * taps.view[2][k]);
    for (size_t i = 0; i < 3; ++i) sums[i] += weight * Load(taps.texel[i] + 3 * k);
  }
  Four sum{};
  for (size_t i = 0; i < 3; ++i) sum += Broadcast(taps.light_weight[i]) * sums[i];
  return {sum[0], sum[1], sum[2]};
}

std::array<float, 3> ViewSvdBtf::SumOfPresent(const SampleQuery& query) const {
  const btf::PairWeights pairs = interpolator_.Lookup(query.v, query.l);
  const size_t texel = TexelOf(query), terms = static_cast<size_t>(terms_);
  Four sum{};
  for (size_t n = 0; n < static_cast<size_t>(pairs.count); ++n) {
    const float* const weights = weights_.data() + static_cast<size_t>(pairs.view[n]) * terms;
    sum += Broadcast(pairs.scale * pairs.weight[n]) *
           WeightedTerms(weights, EigenTexel(pairs.light[n], texel), terms);
  }
  return {sum[0], sum[1], sum[2]};
}

std::array<float, 3> ViewSvdBtf::Evaluate(int x, int y, Vec3 v, Vec3 l) const {
  const SampleQuery query{x, y, v, l};
  Taps taps;
  return TapsOf(query, taps) ? Sum(taps) : SumOfPresent(query);
}

void ViewSvdBtf::EvaluateBatch(std::span<const SampleQuery> queries,
                               std::span<std::array<float, 3>> out) const {
  std::array<Taps, kAtOnce> taps;
  for (size_t first = 0; first < queries.size(); first += kAtOnce) {
    const size_t count = std::min(kAtOnce, queries.size() - first);
    for (size_t i = 0; i < count; ++i) {
      if (!TapsOf(queries[first + i], taps[i])) {
        taps[i].texel[0] = nullptr;
        continue;
      }
      for (const float* const texel : taps[i].texel) {
        __builtin_prefetch(texel);
        __builtin_prefetch(texel + 3 * terms_ - 1);
      }
    }
    for (size_t i = 0; i < count; ++i) {
      out[first + i] =
          taps[i].texel[0] != nullptr ? Sum(taps[i]) : SumOfPresent(queries[first + i]);
    }
  }
}

void ViewSvdBtf::DecodeSamples(std::span<const NodeQuery> queries,
                               std::span<std::array<float, 3>> out) const {
  const auto terms = static_cast<size_t>(terms_);
  const auto texel = [&](const NodeQuery& q) {
    return EigenTexel(q.light, static_cast<size_t>(q.y) * static_cast<size_t>(info_.header.width) +
                                   static_cast<size_t>(q.x));
  };
  for (size_t i = 0; i < queries.size(); ++i) {
    if (i + kAhead < queries.size()) {
      const float* const next = texel(queries[i + kAhead]);
      __builtin_prefetch(next);
      __builtin_prefetch(next + 3 * terms - 1);
    }
    const Four value = WeightedTerms(weights_.data() + static_cast<size_t>(queries[i].view) * terms,
                                     texel(queries[i]), terms);
    out[i] = {value[0], value[1], value[2]};
  }
}

std::vector<btf::Plane> ViewSvdBtf::Planes() const {
  const btf::BtfHeader& h = info_.header;
  const size_t texels = h.texel_count();
  std::vector<btf::Plane> planes;
  planes.push_back({"E", terms_, h.view_count(), {"E"}, false, weights_});
  for (int k = 0; k < terms_; ++k) {
    std::vector<float> values;
    values.reserve(3 * texels * h.lights.size());
    for (int l = 0; l < h.light_count(); ++l) {
      for (int c = 3; c-- > 0;) {
        for (size_t i = 0; i < texels; ++i) values.push_back(EigenTexel(l, i)[3 * k + c]);
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
  const auto terms = static_cast<size_t>(terms_);
  const size_t texels = info_.header.texel_count();
  form.rgb.resize(eigen_textures_.size() - 1);
  for (size_t l = 0; l < info_.header.lights.size(); ++l) {
    for (size_t i = 0; i < texels; ++i) {
      const float* const from = EigenTexel(static_cast<int>(l), i);
      for (size_t k = 0; k < terms; ++k) {
        std::copy_n(from + 3 * k, 3, form.rgb.data() + ((l * terms + k) * texels + i) * 3);
      }
    }
  }
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
      eigen_textures.reserve(layers * texels * 3 + 1);
      eigen_textures.resize(layers * texels * 3);  // only now: the first plane proves the size
      MESORIG_ASSIGN_OR_RETURN(const std::vector<float> values,
                               Dequantised(std::move(plane), quantisation));
      for (size_t l = 0; l < h.lights.size(); ++l) {
        const auto step = 3 * static_cast<size_t>(terms);
        float* const to = eigen_textures.data() + l * texels * step + 3 * static_cast<size_t>(k);
        for (size_t c = 0; c < 3; ++c) {
          const float* const from = values.data() + (3 * l + 2 - c) * texels;
          for (size_t i = 0; i < texels; ++i) to[i * step + c] = from[i];
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
