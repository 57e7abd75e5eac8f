#include <algorithm>
#include <array>

#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/pack_factors.h"

namespace mesorig::codecs::dfmf {
namespace {

constexpr int kVersion = 1, kDefaultTerms = 16, kMaxTerms = 2048;
constexpr int kTermsPerColour = 4;  // luma terms to one of U, and to one of V

// One decorrelated channel: a row a texel, a column a present pair.
class ChannelMatrix final : public algebra::RowSource {
 public:
  ChannelMatrix(const SampleSource& source, const std::vector<size_t>& pairs, size_t channel,
                float floor, const SampleWeights& weights)
      : source_(source), pairs_(pairs), channel_(channel), floor_(floor), weights_(weights) {}
  int64_t rows() const override { return static_cast<int64_t>(source_.header().texel_count()); }
  int64_t cols() const override { return static_cast<int64_t>(pairs_.size()); }
  int64_t granule() const override { return source_.granule(); }
  // In parts: the three colours of all rows at once would take three times the room of the result.
  StatusOr<algebra::ViewF> Rows(int64_t first, int64_t count, float* scratch) const override {
    const int64_t part = (kPart + granule() - 1) / granule() * granule();
    std::vector<float> rgb(3 * pairs_.size() * static_cast<size_t>(std::min(part, count)));
    for (int64_t begin = 0; begin < count; begin += part) {
      const int64_t n = std::min(part, count - begin);
      MESORIG_RETURN_IF_ERROR(source_.Columns(first + begin, n, pairs_, rgb.data()));
      for (size_t p = 0; p < pairs_.size(); ++p) {
        const float* const from = rgb.data() + 3 * p * static_cast<size_t>(n);
        float* const out = scratch + static_cast<int64_t>(p) * count + begin;
        for (int64_t i = 0; i < n; ++i) {
          const std::array<float, 3> value{from[i], from[n + i], from[2 * n + i]};
          out[i] = weights_.texel[static_cast<size_t>(first + begin + i)] *
                   weights_.sample[3 * pairs_[p]] * ToDecorrelated(value.data(), floor_)[channel_];
        }
      }
    }
    return algebra::ViewF(scratch, count, cols(), count);
  }

 private:
  static constexpr int64_t kPart = 64;

  const SampleSource& source_;
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
    return Most(btf.header().texel_count(), btf.present_count());
  }

  StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                   const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
    const btf::BtfHeader& h = source.header();
    const std::vector<size_t> pairs = source.Pairs();
    MESORIG_ASSIGN_OR_RETURN(const int terms,
                             TermsOf(options, kDefaultTerms, Most(h.texel_count(), pairs.size())));
    const int colour_terms =
        options.terms == kAllTerms ? terms : std::max(1, terms / kTermsPerColour);
    EncodeOptions log = options;
    log.weighting = Weighting::kLog;
    MESORIG_ASSIGN_OR_RETURN(log.floor, WideFloor(source, options));
    MESORIG_ASSIGN_OR_RETURN(const SampleWeights weights, WeightsFor(source, log));
    LinearShape shape;
    shape.terms = terms + 2 * colour_terms;
    LinearFactors factors = EmptyFactors(h, shape);
    factors.quantisation = QuantisationOf(options);
    factors.log_floor = static_cast<float>(log.floor);
    factors.decorrelated = true;
    for (size_t channel = 0; channel < 3; ++channel) {
      algebra::SvdOptions svd_options;
      svd_options.rank = channel == 0 ? terms : colour_terms;
      svd_options.block_bytes = options.block_bytes;
      MESORIG_ASSIGN_OR_RETURN(
          const algebra::TruncatedSvd svd,
          algebra::DecomposeTruncated(
              ChannelMatrix(source, pairs, channel, factors.log_floor, weights), svd_options));
      const int first = channel == 0 ? 0 : terms + static_cast<int>(channel - 1) * colour_terms;
      PutChannel(h, pairs, weights, svd, channel, static_cast<size_t>(first), factors);
    }
    RoundFactors(h, factors);
    btf::BtfFileInfo info = InfoOf(source, name(), kVersion);
    info.codec_options_json = OptionsJson(log, factors.quantisation, log.floor,
                                          {{"terms", terms}, {"colour_terms", colour_terms}});
    return LinearBtf::Create(std::move(info), std::move(factors));
  }

 private:
  static int Most(size_t texels, size_t pairs) {
    return static_cast<int>(std::min<size_t>({kMaxTerms, texels, pairs}));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const DfmfEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::dfmf
