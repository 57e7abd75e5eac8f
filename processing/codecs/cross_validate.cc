#include "processing/codecs/cross_validate.h"

#include <Eigen/Dense>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "processing/btf/errors.h"

namespace mesorig::codecs {
namespace {

constexpr double kTiny = 1e-9;
constexpr int kMinLights = 4;  // three unknowns of Lambert's law beside the one left out

struct SquareSum {
  double sum = 0, count = 0;
  void Add(double error) {
    sum += error * error;
    count += 1;
  }
  void Add(const SquareSum& other) {
    sum += other.sum;
    count += other.count;
  }
  double Psnr(double peak) const { return btf::PsnrDb(peak, std::sqrt(sum / std::max(1.0, count))); }
};

// Rec. 601 luma, clipped as the file's values are.
struct Grey {
  double factor, high;
  explicit Grey(const btf::BtfHeader& header)
      : factor(header.calibrated ? 1.0 : 255.0),
        high(header.calibrated ? std::numeric_limits<double>::infinity() : 255.0) {}
  double Raw(std::span<const float> rgb, size_t texel) const {
    return factor * (0.299 * rgb[3 * texel] + 0.587 * rgb[3 * texel + 1] +
                     0.114 * rgb[3 * texel + 2]);
  }
  double Clip(double grey) const { return std::clamp(grey, 0.0, high); }
};

// One light held out of a BTF; back when this goes.
class HeldOut {
 public:
  HeldOut(btf::SampledBtf& btf, int light) : btf_(btf), light_(light) {
    for (int v = 0; v < btf.header().view_count(); ++v) {
      if (!btf.Present(v, light)) continue;
      views_.push_back(v);
      btf.SetPresent(v, light, false);
    }
  }
  HeldOut(const HeldOut&) = delete;
  HeldOut& operator=(const HeldOut&) = delete;
  ~HeldOut() {
    for (const int v : views_) btf_.SetPresent(v, light_, true);
  }
  const std::vector<int>& views() const { return views_; }

 private:
  btf::SampledBtf& btf_;
  int light_;
  std::vector<int> views_;
};

// Predicts `light` of `view` by Lambert's law from the lights that are present.
SquareSum LambertErrors(const btf::SampledBtf& btf, int view, int light) {
  const btf::BtfHeader& h = btf.header();
  std::vector<int> lights;
  for (int l = 0; l < h.light_count(); ++l) {
    if (btf.Present(view, l)) lights.push_back(l);
  }
  Eigen::MatrixXd directions(static_cast<Eigen::Index>(lights.size()), 3);
  for (size_t i = 0; i < lights.size(); ++i) {
    const Vec3& d = h.lights[static_cast<size_t>(lights[i])];
    directions.row(static_cast<Eigen::Index>(i)) << d.x, d.y, d.z;
  }
  const Vec3& d = h.lights[static_cast<size_t>(light)];
  Eigen::Matrix3d normal = directions.transpose() * directions;
  normal.diagonal().array() += kTiny;  // fewer than three independent lights
  const Eigen::VectorXd combination = directions * normal.ldlt().solve(Eigen::Vector3d(d.x, d.y, d.z));
  const Grey grey(h);
  const auto measured = btf.Image(view, light);
  SquareSum errors;
  for (size_t texel = 0; texel < h.texel_count(); ++texel) {
    if (!h.InMask(texel)) continue;
    double predicted = 0;
    for (size_t i = 0; i < lights.size(); ++i) {
      predicted += combination[static_cast<Eigen::Index>(i)] *
                   grey.Raw(btf.Image(view, lights[i]), texel);
    }
    errors.Add(grey.Clip(predicted) - grey.Clip(grey.Raw(measured, texel)));
  }
  return errors;
}

SquareSum Errors(const btf::BtfHeader& h, std::span<const float> measured,
                 std::span<const float> predicted) {
  const Grey grey(h);
  SquareSum errors;
  for (size_t texel = 0; texel < h.texel_count(); ++texel) {
    if (!h.InMask(texel)) continue;
    errors.Add(grey.Clip(grey.Raw(predicted, texel)) - grey.Clip(grey.Raw(measured, texel)));
  }
  return errors;
}

}  // namespace

StatusOr<CrossValidation> CrossValidate(btf::SampledBtf& btf, const Encoder& encoder,
                                        const EncodeOptions& options,
                                        const OnPrediction& on_prediction,
                                        const OnProgress& on_progress) {
  const btf::BtfHeader& h = btf.header();
  if (h.light_count() < kMinLights) {
    return InvalidArgument("cross-validation needs at least {} lights, there are {}", kMinLights,
                           h.light_count());
  }
  const double peak = h.calibrated ? btf::kPsnrPeak : 255.0;
  CrossValidation result;
  SquareSum all, all_lambert;
  std::vector<float> predicted(btf.image_size());
  for (int light = 0; light < h.light_count(); ++light) {
    const HeldOut held(btf, light);
    if (held.views().empty()) continue;
    const auto start = std::chrono::steady_clock::now();
    MESORIG_ASSIGN_OR_RETURN(const auto encoded, EncodeBtf(encoder, btf, options));
    result.seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    SquareSum errors, lambert;
    for (const int view : held.views()) {
      MESORIG_RETURN_IF_ERROR(
          encoded->PredictImage(view, h.lights[static_cast<size_t>(light)], predicted));
      errors.Add(Errors(h, btf.Image(view, light), predicted));
      lambert.Add(LambertErrors(btf, view, light));
      if (on_prediction) {
        MESORIG_RETURN_IF_ERROR(on_prediction(view, light, btf.Image(view, light), predicted));
      }
    }
    result.lights.push_back({light, errors.Psnr(peak), lambert.Psnr(peak)});
    all.Add(errors);
    all_lambert.Add(lambert);
    if (on_progress) on_progress((light + 1.0) / h.light_count());
  }
  if (result.lights.empty()) return InvalidArgument("no (view, light) pair is present");
  result.psnr_db = all.Psnr(peak);
  result.lambert_psnr_db = all_lambert.Psnr(peak);
  return result;
}

}  // namespace mesorig::codecs
