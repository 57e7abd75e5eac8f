#include <algorithm>
#include <cmath>

#include "processing/codecs/algebra/matrix.h"
#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/pack_factors.h"
#include "processing/codecs/linear/sample_weights.h"
#include "processing/codecs/per_texel/encode_chain.h"

namespace mesorig::codecs::hf {
namespace {

using algebra::MatrixD;
using per_texel::Axis;
using per_texel::kGrid;

constexpr double kRidge = 1e-6;   // of the mean diagonal: factors of one product can trade constants
constexpr double kSmooth = 0.02;  // of a half-vector node's mean weight: neighbours on the grid
constexpr double kLargestLog = 40;

// log(B + floor) = a(v) + c(l, channel) + b(h, channel): the normal equations of all texels.
class LogFit {
 public:
  LogFit(const btf::BtfHeader& h, const per_texel::ChainFitter& fitter,
         const std::vector<float>& weights, double floor)
      : layout_(fitter.layout()), weights_(weights), floor_(floor),
        normal_(static_cast<int64_t>(layout_.size), static_cast<int64_t>(layout_.size)) {
    double total = 0;
    for (size_t i = 0; i < weights.size(); ++i) {
      const size_t pair = fitter.pairs()[i / 3];
      Row row;
      size_t used = 0;
      const auto add = [&](size_t unknown, double factor) { row[used++] = {unknown, factor}; };
      const per_texel::PairTaps taps =
          per_texel::TapsOf(fitter.stages(), h, static_cast<int>(pair / h.lights.size()),
                            static_cast<int>(pair % h.lights.size()));
      add(layout_.stages[0].p_first + taps.p[0].node[0], 1);
      add(layout_.stages[0].q_first + 3 * taps.q[0].node[0] + i % 3, 1);
      for (size_t k = 0; k < 4; ++k) {
        add(layout_.stages[1].q_first + 3 * taps.q[1].node[k] + i % 3, taps.q[1].weight[k]);
      }
      for (const auto& [m, a] : row) {
        for (const auto& [n, b] : row) {
          normal_(static_cast<int64_t>(m), static_cast<int64_t>(n)) += weights[i] * a * b;
        }
      }
      total += weights[i];
      rows_.push_back(row);
    }
    Smooth(kSmooth * total / (3 * kGrid * kGrid));
  }

  Status operator()(const per_texel::TexelBlock& block) const {
    MatrixD right(normal_.rows, static_cast<int64_t>(block.texels));
    for (size_t t = 0; t < block.texels; ++t) {
      const auto y = block.Y(t);
      double* const column = right.Column(static_cast<int64_t>(t));
      for (size_t i = 0; i < y.size(); ++i) {
        const double log = weights_[i] * std::log(std::max(static_cast<double>(y[i]), 0.0) + floor_);
        for (const auto& [n, factor] : rows_[i]) column[n] += factor * log;
      }
    }
    MESORIG_RETURN_IF_ERROR(algebra::SolvePositive(normal_, kRidge, right));
    std::transform(right.values.begin(), right.values.end(), block.values.begin(), [](double x) {
      return static_cast<float>(std::exp(std::clamp(x, -kLargestLog, kLargestLog)));
    });
    return OkStatus();
  }

 private:
  using Row = std::array<std::pair<size_t, double>, 6>;

  void Smooth(double weight) {
    const auto couple = [&](size_t m, size_t n) {
      const auto a = static_cast<int64_t>(m), b = static_cast<int64_t>(n);
      normal_(a, a) += weight, normal_(b, b) += weight;
      normal_(a, b) -= weight, normal_(b, a) -= weight;
    };
    for (size_t y = 0; y < kGrid; ++y) {
      for (size_t x = 0; x < kGrid; ++x) {
        for (size_t c = 0; c < 3; ++c) {
          const size_t at = layout_.stages[1].q_first + 3 * (y * kGrid + x) + c;
          if (x + 1 < kGrid) couple(at, at + 3);
          if (y + 1 < kGrid) couple(at, at + 3 * kGrid);
        }
      }
    }
  }

  const per_texel::Layout& layout_;
  const std::vector<float>& weights_;
  double floor_;
  MatrixD normal_;
  std::vector<Row> rows_;
};

class HfEncoder final : public Encoder {
 public:
  std::string_view name() const override { return "hf"; }
  unsigned options() const override { return kWeighting | kLogWeighting | kQuantisation; }

  // Müller et al. 2004, Eq. 9. The error is relative whatever the weighting.
  StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                   const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
    const btf::BtfHeader& h = source.header();
    if (options.terms != 0 && options.terms != kAllTerms) {
      return InvalidArgument("codec {} has one product, not a choice of terms", name());
    }
    EncodeOptions log = options;
    log.weighting = Weighting::kLog;
    MESORIG_ASSIGN_OR_RETURN(const double floor, WideFloor(source, options));
    per_texel::ChainEncoding encoding;
    encoding.stages = {{Axis::kView, Axis::kLight, 1}, {Axis::kNone, Axis::kHalf, 1}};
    encoding.quantisation = QuantisationOf(options);
    encoding.floor = floor;
    const per_texel::ChainFitter fitter(h, source.present(), encoding.stages);
    MESORIG_ASSIGN_OR_RETURN(const per_texel::ChainWeights weights,
                             per_texel::ChainWeightsFor(source, options, fitter, floor));
    const LogFit fit(h, fitter, weights.squares, floor);
    return per_texel::EncodeChain(source, log, encoding, weights, *this, fit);
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const HfEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::hf
