#include "renderer/gl/btf_source.h"

#include <algorithm>

namespace mesorig::renderer {

StatusOr<BtfSource> BtfSource::Make(std::unique_ptr<btf::SampledBtf> sampled,
                                    std::unique_ptr<codecs::EncodedBtf> encoded) {
  const btf::BtfHeader& header = sampled ? sampled->header() : encoded->info().header;
  if (!header.cosine_included) {
    return InvalidArgument(
        "the BTF's values do not carry the cosine of the light (cosine flag 0); "
        "permitted is 1: import it again");
  }
  std::vector<uint8_t> present;
  if (encoded) {
    present = encoded->info().present;
  } else {
    for (int v = 0; v < header.view_count(); ++v) {
      for (int l = 0; l < header.light_count(); ++l) present.push_back(sampled->Present(v, l));
    }
  }
  MESORIG_ASSIGN_OR_RETURN(auto interpolator,
                           btf::PairInterpolator::Build(header, std::move(present)));
  return BtfSource(std::move(sampled), std::move(encoded), std::move(interpolator));
}

StatusOr<BtfSource> BtfSource::FromSampled(btf::SampledBtf sampled) {
  return Make(std::make_unique<btf::SampledBtf>(std::move(sampled)), nullptr);
}

StatusOr<BtfSource> BtfSource::FromEncoded(std::unique_ptr<codecs::EncodedBtf> encoded) {
  return Make(nullptr, std::move(encoded));
}

StatusOr<BtfSource> BtfSource::Load(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const btf::BtfFileInfo info, btf::ReadBtfInfo(path));
  std::unique_ptr<btf::SampledBtf> sampled;
  std::unique_ptr<codecs::EncodedBtf> encoded;
  if (info.codec == "raw") {
    MESORIG_ASSIGN_OR_RETURN(btf::SampledBtf read, btf::ReadSampledBtf(path));
    sampled = std::make_unique<btf::SampledBtf>(std::move(read));
  } else {
    MESORIG_ASSIGN_OR_RETURN(encoded, codecs::ReadEncodedBtf(path));
  }
  auto source = Make(std::move(sampled), std::move(encoded));
  if (!source.ok()) return Annotate(source.status(), path.string());
  return source;
}

const btf::BtfHeader& BtfSource::header() const {
  return sampled_ ? sampled_->header() : encoded_->info().header;
}

std::string_view BtfSource::codec() const {
  return sampled_ ? std::string_view("raw") : std::string_view(encoded_->info().codec);
}

bool BtfSource::Present(int view, int light) const {
  if (sampled_) return sampled_->Present(view, light);
  return encoded_->info().present[static_cast<size_t>(view) * header().lights.size() +
                                  static_cast<size_t>(light)] != 0;
}

std::vector<float> BtfSource::Image(int view, int light) const {
  if (sampled_) {
    const auto image = sampled_->Image(view, light);
    return {image.begin(), image.end()};
  }
  std::vector<float> image(header().texel_count() * 3);
  encoded_->DecodeImage(view, light, image);
  return image;
}

std::array<float, 3> BtfSource::Evaluate(int x, int y, Vec3 v, Vec3 l) const {
  if (encoded_) return encoded_->before_clamping().Evaluate(x, y, v, l);
  const btf::PairWeights pairs = interpolator_.Lookup(v, l);
  const size_t first =
      (static_cast<size_t>(y) * static_cast<size_t>(header().width) + static_cast<size_t>(x)) * 3;
  std::array<double, 3> sum{};
  for (size_t n = 0; n < static_cast<size_t>(pairs.count); ++n) {
    const auto image = sampled_->Image(pairs.view[n], pairs.light[n]);
    for (size_t c = 0; c < 3; ++c) sum[c] += double{pairs.weight[n]} * image[first + c];
  }
  std::array<float, 3> value{};
  for (size_t c = 0; c < 3; ++c) value[c] = static_cast<float>(sum[c] * pairs.scale);
  return value;
}

StatusOr<std::vector<float>> BtfSource::PlainTexture() const {
  std::vector<int> views(header().views.size());
  for (size_t i = 0; i < views.size(); ++i) views[i] = static_cast<int>(i);
  std::stable_sort(views.begin(), views.end(), [&](int a, int b) {
    return header().views[static_cast<size_t>(a)].z > header().views[static_cast<size_t>(b)].z;
  });
  for (int view : views) {
    std::vector<double> sum(header().texel_count() * 3);
    double squares = 0;
    for (int light = 0; light < header().light_count(); ++light) {
      const double cosine = header().lights[static_cast<size_t>(light)].z;
      if (!Present(view, light) || cosine <= 0) continue;
      const std::vector<float> image = Image(view, light);
      for (size_t i = 0; i < sum.size(); ++i) sum[i] += cosine * image[i];
      squares += cosine * cosine;
    }
    if (squares <= 0) continue;  // nothing of this view is present
    std::vector<float> texture(sum.size());
    for (size_t i = 0; i < sum.size(); ++i) texture[i] = static_cast<float>(sum[i] / squares);
    return texture;
  }
  return FailedPrecondition("the BTF has no image that is present");
}

}  // namespace mesorig::renderer
