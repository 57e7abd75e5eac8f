#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "processing/codecs/encoder.h"
#include "processing/codecs/rf_ptm/fit.h"
#include "processing/codecs/rf_ptm/rf_ptm.h"

namespace mesorig::codecs::rf_ptm {
namespace {

using Eigen::MatrixXd;

struct ViewData {
  std::vector<Vec3> lights;
  std::vector<std::span<const float>> images;
};

ViewData PresentImages(const btf::SampledBtf& btf, int view) {
  ViewData data;
  for (int l = 0; l < btf.header().light_count(); ++l) {
    if (!btf.Present(view, l)) continue;
    data.lights.push_back(btf.header().lights[static_cast<size_t>(l)]);
    data.images.push_back(btf.Image(view, l));
  }
  return data;
}

// Mean products of the images of one view inside the mask.
MatrixXd Gram(const btf::BtfHeader& header, const ViewData& data) {
  const auto n = static_cast<Eigen::Index>(data.images.size());
  MatrixXd gram = MatrixXd::Zero(n, n);
  Eigen::VectorXd values(n);
  double count = 0;
  for (size_t i = 0; i < 3 * header.texel_count(); ++i) {
    if (!header.InMask(i / 3)) continue;
    for (Eigen::Index k = 0; k < n; ++k) values[k] = data.images[static_cast<size_t>(k)][i];
    gram.selfadjointView<Eigen::Lower>().rankUpdate(values);
    count += 1;
  }
  return MatrixXd(gram.selfadjointView<Eigen::Lower>()) / std::max(1.0, count);
}

// out: [coefficient][texel][rgb]
void FitView(const btf::SampledBtf& btf, int view, double regularisation, float* out) {
  const ViewData data = PresentImages(btf, view);
  if (data.lights.empty()) return;
  // Light vectors and lamps of a calibrated rig are measured; those of photographs are doubted.
  const Eigen::VectorXd weights =
      btf.header().calibrated
          ? Eigen::VectorXd(Eigen::VectorXd::Ones(static_cast<Eigen::Index>(data.lights.size())))
          : LightWeights(data.lights, Gram(btf.header(), data));
  const MatrixXd fit = FitOperator(data.lights, weights, regularisation);
  const size_t image = btf.image_size();
  std::vector<double> sums(image);
  for (Eigen::Index a = 0; a < kCoefficients; ++a) {
    std::fill(sums.begin(), sums.end(), 0.0);
    for (size_t k = 0; k < data.images.size(); ++k) {
      const double factor = fit(a, static_cast<Eigen::Index>(k));
      for (size_t i = 0; i < image; ++i) sums[i] += factor * data.images[k][i];
    }
    std::transform(sums.begin(), sums.end(), out + static_cast<size_t>(a) * image,
                   [](double sum) { return static_cast<float>(sum); });
  }
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

  StatusOr<std::unique_ptr<EncodedBtf>> Encode(const btf::SampledBtf& btf,
                                               const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(btf, options, *this));
    if (options.terms != 0 && options.terms != kAllTerms) {
      return InvalidArgument("codec {} has six coefficients, not a choice of terms", kName);
    }
    const double regularisation =
        options.regularisation < 0 ? kDefaultRegularisation : options.regularisation;
    if (!std::isfinite(regularisation)) {
      return InvalidArgument("regularisation {} is not finite", regularisation);
    }
    const size_t of_view = kCoefficients * btf.image_size();
    std::vector<float> coefficients(btf.header().views.size() * of_view, 0.0f);
    for (int v = 0; v < btf.header().view_count(); ++v) {
      FitView(btf, v, regularisation, coefficients.data() + static_cast<size_t>(v) * of_view);
    }
    btf::BtfFileInfo info = InfoOf(btf, kName, kVersion);
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
