#include <algorithm>

#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/pack_factors.h"

namespace mesorig::codecs::dfmf {
namespace {

constexpr int kVersion = 1, kDefaultTerms = 16, kMaxTerms = 2048;
constexpr int kTermsPerColour = 4;  // luma terms to one of U, and to one of V

// One decorrelated channel: a row a texel, a column a present pair.
class ChannelMatrix final : public algebra::RowSource {
 public:
  ChannelMatrix(const btf::SampledBtf& btf, const std::vector<size_t>& pairs, size_t channel,
                float floor, const SampleWeights& weights)
      : btf_(btf), pairs_(pairs), channel_(channel), floor_(floor), weights_(weights) {}
  int64_t rows() const override { return static_cast<int64_t>(btf_.header().texel_count()); }
  int64_t cols() const override { return static_cast<int64_t>(pairs_.size()); }
  StatusOr<algebra::ViewF> Rows(int64_t first, int64_t count, float* scratch) const override {
    const size_t lights = btf_.header().lights.size();
    float* out = scratch;
    for (const size_t pair : pairs_) {
      const auto image = btf_.Image(static_cast<int>(pair / lights), static_cast<int>(pair % lights));
      for (int64_t i = 0; i < count; ++i) {
        const auto texel = static_cast<size_t>(first + i);
        *out++ = weights_.texel[texel] * weights_.sample[3 * pair] *
                 ToDecorrelated(image.data() + 3 * texel, floor_)[channel_];
      }
    }
    return algebra::ViewF(scratch, count, cols(), count);
  }

 private:
  const btf::SampledBtf& btf_;
  const std::vector<size_t>& pairs_;
  size_t channel_;
  float floor_;
  const SampleWeights& weights_;
};

// U sigma and V, freed from the weights, as the terms from `first` on.
void PutChannel(const btf::BtfHeader& h, const std::vector<size_t>& pairs,
                const SampleWeights& weights, const algebra::TruncatedSvd& svd, size_t channel,
                size_t first, LinearFactors& factors) {
  const auto stride = static_cast<size_t>(factors.shape.stride());
  for (size_t k = 0; k < svd.sigma.size(); ++k) {
    for (size_t i = 0; i < h.texel_count(); ++i) {
      factors.g[i * stride + first + k] = static_cast<float>(
          svd.u(static_cast<int64_t>(i), static_cast<int64_t>(k)) * svd.sigma[k] /
          weights.texel[i]);
    }
    for (size_t p = 0; p < pairs.size(); ++p) {
      factors.h[(3 * pairs[p] + channel) * stride + first + k] =
          svd.v(static_cast<int64_t>(p), static_cast<int64_t>(k)) / weights.sample[3 * pairs[p]];
    }
  }
}

class DfmfEncoder final : public Encoder {
 public:
  std::string_view name() const override { return "dfmf"; }
  unsigned options() const override { return kWeighting | kLogWeighting | kQuantisation; }
  int max_terms(const btf::SampledBtf& btf) const override {
    return static_cast<int>(
        std::min<size_t>({kMaxTerms, btf.header().texel_count(), btf.present_count()}));
  }

  StatusOr<std::unique_ptr<EncodedBtf>> Encode(const btf::SampledBtf& btf,
                                               const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(btf, options, *this));
    MESORIG_ASSIGN_OR_RETURN(const int terms, TermsOf(options, kDefaultTerms, max_terms(btf)));
    const int colour_terms =
        options.terms == kAllTerms ? terms : std::max(1, terms / kTermsPerColour);
    EncodeOptions log = options;
    log.weighting = Weighting::kLog;
    const double floor = WideFloor(btf, options);
    log.floor = floor;
    const SampleWeights weights = WeightsFor(btf, log);
    btf::BtfFileInfo info = InfoOf(btf, name(), kVersion);
    std::vector<size_t> pairs;
    for (size_t pair = 0; pair < info.present.size(); ++pair) {
      if (info.present[pair] != 0) pairs.push_back(pair);
    }
    LinearShape shape;
    shape.terms = terms + 2 * colour_terms;
    LinearFactors factors = EmptyFactors(btf.header(), shape);
    factors.quantisation = QuantisationOf(options);
    factors.log_floor = static_cast<float>(floor);
    factors.decorrelated = true;
    for (size_t channel = 0; channel < 3; ++channel) {
      algebra::SvdOptions svd_options;
      svd_options.rank = channel == 0 ? terms : colour_terms;
      svd_options.block_bytes = options.block_bytes;
      MESORIG_ASSIGN_OR_RETURN(
          const algebra::TruncatedSvd svd,
          algebra::DecomposeTruncated(
              ChannelMatrix(btf, pairs, channel, factors.log_floor, weights), svd_options));
      const int first = channel == 0 ? 0 : terms + static_cast<int>(channel - 1) * colour_terms;
      PutChannel(btf.header(), pairs, weights, svd, channel, static_cast<size_t>(first),
                 factors);
    }
    RoundFactors(btf.header(), factors);
    info.codec_options_json = OptionsJson(log, factors.quantisation, floor,
                                          {{"terms", terms}, {"colour_terms", colour_terms}});
    return LinearBtf::Create(std::move(info), std::move(factors));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const DfmfEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::dfmf
