#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "processing/codecs/algebra/threads.h"
#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/sample_source.h"
#include "processing/codecs/rf_ptm/fit.h"
#include "processing/codecs/rf_ptm/rf_ptm.h"

namespace mesorig::codecs::rf_ptm {
namespace {

using Eigen::MatrixXd;

// One view: the columns of its pairs among those of all, 3 a light, and what fits them.
struct View {
  size_t first = 0;  // of source.Pairs()
  std::vector<Vec3> lights;
  MatrixXd gram;  // mean products of its images inside the mask
  MatrixXd fit;   // coefficients x lights
};

std::vector<View> ViewsOf(const SampleSource& source) {
  const btf::BtfHeader& h = source.header();
  std::vector<View> views(h.views.size());
  const std::vector<size_t> pairs = source.Pairs();
  for (size_t i = 0; i < pairs.size(); ++i) {
    View& view = views[pairs[i] / h.lights.size()];
    if (view.lights.empty()) view.first = i;
    view.lights.push_back(h.lights[pairs[i] % h.lights.size()]);
  }
  return views;
}

// Reads the source once.
Status AddGrams(const SampleSource& source, int64_t block_bytes, std::vector<View>& views) {
  const btf::BtfHeader& h = source.header();
  std::vector<std::vector<MatrixXd>> sums(static_cast<size_t>(algebra::Threads()));
  for (std::vector<MatrixXd>& of_worker : sums) {
    for (const View& view : views) {
      const auto n = static_cast<Eigen::Index>(view.lights.size());
      of_worker.push_back(MatrixXd::Zero(n, n));
    }
  }
  MESORIG_RETURN_IF_ERROR(ForSampleBlocks(
      source, block_bytes, [&](int worker, int64_t first, int64_t count, const float* samples) {
        for (size_t v = 0; v < views.size(); ++v) {
          const auto lights = static_cast<Eigen::Index>(views[v].lights.size());
          const float* const from = samples + 3 * views[v].first * static_cast<size_t>(count);
          MatrixXd columns = Eigen::Map<const Eigen::MatrixXf>(from, 3 * count, lights).cast<double>();
          for (int64_t i = 0; i < 3 * count; ++i) {
            if (!h.InMask(static_cast<size_t>(first + i % count))) columns.row(i).setZero();
          }
          sums[static_cast<size_t>(worker)][v].noalias() += columns.transpose() * columns;
        }
        return OkStatus();
      }));
  double inside = 0;
  for (size_t i = 0; i < h.texel_count(); ++i) inside += h.InMask(i) ? 3 : 0;
  for (size_t v = 0; v < views.size(); ++v) {
    views[v].gram = sums[0][v];
    for (size_t w = 1; w < sums.size(); ++w) views[v].gram += sums[w][v];
    views[v].gram /= std::max(1.0, inside);
  }
  return OkStatus();
}

// [view][coefficient][texel][rgb]
StatusOr<std::vector<float>> Fit(const SampleSource& source, double regularisation,
                                 int64_t block_bytes) {
  const btf::BtfHeader& h = source.header();
  std::vector<View> views = ViewsOf(source);
  // Light vectors and lamps of a calibrated rig are measured; those of photographs are doubted.
  if (!h.calibrated) MESORIG_RETURN_IF_ERROR(AddGrams(source, block_bytes, views));
  for (View& view : views) {
    if (view.lights.empty()) continue;
    Eigen::VectorXd weights = Eigen::VectorXd::Ones(static_cast<Eigen::Index>(view.lights.size()));
    if (!h.calibrated) weights = LightWeights(view.lights, view.gram);
    view.fit = FitOperator(view.lights, weights, regularisation);
  }
  const size_t image = 3 * h.texel_count();
  std::vector<float> coefficients(views.size() * kCoefficients * image, 0.0f);
  MESORIG_RETURN_IF_ERROR(ForSampleBlocks(
      source, block_bytes, [&](int, int64_t first, int64_t count, const float* samples) {
        const auto n = static_cast<size_t>(count);
        std::vector<double> sums(3 * n);
        for (size_t v = 0; v < views.size(); ++v) {
          const float* const columns = samples + 3 * views[v].first * n;
          for (size_t a = 0; a < kCoefficients; ++a) {
            std::fill(sums.begin(), sums.end(), 0.0);
            for (size_t k = 0; k < views[v].lights.size(); ++k) {
              const double factor =
                  views[v].fit(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(k));
              for (size_t i = 0; i < 3 * n; ++i) sums[i] += factor * columns[3 * k * n + i];
            }
            float* const out = coefficients.data() + (v * kCoefficients + a) * image +
                               3 * static_cast<size_t>(first);
            for (size_t i = 0; i < 3 * n; ++i) out[i % n * 3 + i / n] = static_cast<float>(sums[i]);
          }
        }
        return OkStatus();
      }));
  return coefficients;
}

// The power of two that brings the largest coefficient into (2^11, 2^12].
double ScaleFor(const std::vector<float>& coefficients) {
  float largest = 0;
  for (const float a : coefficients) largest = std::max(largest, std::abs(a));
  int exponent = 12;
  if (largest > 0) std::frexp(largest, &exponent);
  return std::ldexp(1.0, std::clamp(exponent, -100, 100) - 12);
}

class RfPtmEncoder final : public Encoder {
 public:
  std::string_view name() const override { return kName; }

  StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                   const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
    if (options.terms != 0 && options.terms != kAllTerms) {
      return InvalidArgument("codec {} has six coefficients, not a choice of terms", kName);
    }
    const double regularisation =
        options.regularisation < 0 ? kDefaultRegularisation : options.regularisation;
    if (!std::isfinite(regularisation)) {
      return InvalidArgument("regularisation {} is not finite", regularisation);
    }
    MESORIG_ASSIGN_OR_RETURN(std::vector<float> coefficients,
                             Fit(source, regularisation, options.block_bytes));
    btf::BtfFileInfo info = InfoOf(source, kName, kVersion);
    info.value_scale = ScaleFor(coefficients);
    const auto inverse = static_cast<float>(1 / info.value_scale);
    for (float& a : coefficients) a *= inverse;
    btf::RoundToHalf(coefficients);
    info.codec_options_json = nlohmann::json{{"regularisation", regularisation}}.dump();
    MESORIG_ASSIGN_OR_RETURN(auto encoded,
                             RfPtmBtf::Create(std::move(info), std::move(coefficients)));
    return std::unique_ptr<EncodedBtf>(std::move(encoded));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const RfPtmEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::rf_ptm
