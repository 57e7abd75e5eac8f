#include "processing/codecs/encoder.h"
#include "processing/codecs/sample/mean.h"

namespace mesorig::codecs::sample {
namespace {

class MeanEncoder final : public Encoder {
 public:
  std::string_view name() const override { return kName; }

  // Least squares: a = sum(f cos) / sum(cos^2) over the pairs that are present.
  StatusOr<std::unique_ptr<EncodedBtf>> Encode(const btf::SampledBtf& btf,
                                               const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(btf, options, *this));
    if (options.terms != 0 && options.terms != kAllTerms) {
      return InvalidArgument("codec {} has one image, not a choice of terms", kName);
    }
    std::vector<double> sums(btf.image_size(), 0.0);
    double squares = 0;
    for (int v = 0; v < btf.header().view_count(); ++v) {
      for (int l = 0; l < btf.header().light_count(); ++l) {
        if (!btf.Present(v, l)) continue;
        const float cosine = Cosine(btf.header(), btf.header().lights[static_cast<size_t>(l)]);
        const auto image = btf.Image(v, l);
        for (size_t i = 0; i < image.size(); ++i) sums[i] += cosine * image[i];
        squares += cosine * cosine;
      }
    }
    std::vector<float> albedo(sums.size(), 0.0f);
    for (size_t i = 0; i < sums.size() && squares > 0; ++i) {
      albedo[i] = static_cast<float>(sums[i] / squares);
    }
    return std::unique_ptr<EncodedBtf>(
        new MeanBtf(InfoOf(btf, kName, kVersion), std::move(albedo)));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const MeanEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::sample
