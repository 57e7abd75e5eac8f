#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/sample_source.h"
#include "processing/codecs/sample/mean.h"

namespace mesorig::codecs::sample {
namespace {

class MeanEncoder final : public Encoder {
 public:
  std::string_view name() const override { return kName; }

  // Least squares: a = sum(f cos) / sum(cos^2) over the pairs that are present.
  StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                   const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
    if (options.terms != 0 && options.terms != kAllTerms) {
      return InvalidArgument("codec {} has one image, not a choice of terms", kName);
    }
    const btf::BtfHeader& h = source.header();
    const std::vector<size_t> pairs = source.Pairs();
    std::vector<float> cosines;
    double squares = 0;
    for (const size_t pair : pairs) {
      cosines.push_back(Cosine(h, h.lights[pair % h.lights.size()]));
      squares += cosines.back() * cosines.back();
    }
    std::vector<float> albedo(3 * h.texel_count(), 0.0f);
    MESORIG_RETURN_IF_ERROR(ForSampleBlocks(
        source, options.block_bytes,
        [&](int, int64_t first, int64_t count, const float* samples) {
          const auto n = static_cast<size_t>(count);
          std::vector<double> sums(3 * n, 0.0);
          for (size_t j = 0; j < 3 * pairs.size(); ++j) {
            for (size_t i = 0; i < n; ++i) sums[3 * i + j % 3] += cosines[j / 3] * *samples++;
          }
          for (size_t i = 0; i < sums.size() && squares > 0; ++i) {
            albedo[3 * static_cast<size_t>(first) + i] = static_cast<float>(sums[i] / squares);
          }
          return OkStatus();
        }));
    return std::unique_ptr<EncodedBtf>(
        new MeanBtf(InfoOf(source, kName, kVersion), std::move(albedo)));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const MeanEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::sample
