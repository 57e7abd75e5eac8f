#include "processing/btf/errors.h"

#include <algorithm>
#include <cmath>

namespace mesorig::btf {
namespace {

constexpr double kSameDirection = 1e-4;  // rad

Status CheckSameDirections(const std::vector<Vec3>& a, const std::vector<Vec3>& b,
                           std::string_view what) {
  if (a.size() != b.size()) {
    return InvalidArgument("{} {}s against {} of the reference", a.size(), what, b.size());
  }
  for (size_t i = 0; i < a.size(); ++i) {
    const double angle = AngleBetween(Normalized(a[i]), Normalized(b[i]));
    if (angle > kSameDirection) {
      return InvalidArgument("{} {} is {:.6f} rad from the reference's, at most {} is permitted",
                             what, i, angle, kSameDirection);
    }
  }
  return OkStatus();
}

struct Sums {
  double squared_difference = 0, squared_reference = 0, max_abs = 0;
  size_t samples = 0;
};

Status AddImage(const BtfHeader& header, std::span<const float> a, std::span<const float> b,
                Sums& sums) {
  for (size_t texel = 0; texel < header.texel_count(); ++texel) {
    if (!header.InMask(texel)) continue;
    for (size_t i = 3 * texel; i < 3 * texel + 3; ++i) {
      const double x = a[i], y = b[i], difference = x - y;
      if (!std::isfinite(difference)) {
        return InvalidArgument("texel {} holds a value that is not finite", texel);
      }
      sums.squared_difference += difference * difference;
      sums.squared_reference += y * y;
      sums.max_abs = std::max(sums.max_abs, std::abs(difference));
    }
    sums.samples += 3;
  }
  return OkStatus();
}

}  // namespace

double PsnrPeak(const BtfHeader& header) { return header.calibrated ? kPsnrPeak : 1.0; }

double PsnrDb(double peak, double rmse) {
  if (rmse <= 0) return kMaxPsnrDb;
  return std::min(kMaxPsnrDb, 20 * std::log10(peak / rmse));
}

StatusOr<BtfErrors> CompareBtf(const SampledBtf& a, const SampledBtf& reference) {
  const BtfHeader &left = a.header(), &right = reference.header();
  if (left.width != right.width || left.height != right.height) {
    return InvalidArgument("{} x {} texels against {} x {} of the reference", left.width,
                           left.height, right.width, right.height);
  }
  MESORIG_RETURN_IF_ERROR(CheckSameDirections(left.views, right.views, "view"));
  MESORIG_RETURN_IF_ERROR(CheckSameDirections(left.lights, right.lights, "light"));
  Sums sums;
  BtfErrors errors;
  for (int v = 0; v < right.view_count(); ++v) {
    for (int l = 0; l < right.light_count(); ++l) {
      if (!a.Present(v, l) || !reference.Present(v, l)) continue;
      const Status status = AddImage(right, a.Image(v, l), reference.Image(v, l), sums);
      if (!status.ok()) return Annotate(status, fmt::format("view {}, light {}", v, l));
      ++errors.pairs;
    }
  }
  if (sums.samples == 0) return InvalidArgument("nothing is present in both");
  if (sums.squared_reference <= 0) return InvalidArgument("the reference is zero everywhere");
  errors.samples = sums.samples;
  errors.rel_error = std::sqrt(sums.squared_difference / sums.squared_reference);
  errors.rmse = std::sqrt(sums.squared_difference / static_cast<double>(sums.samples));
  errors.max_abs = sums.max_abs;
  errors.peak = PsnrPeak(right);
  errors.psnr_db = PsnrDb(errors.peak, errors.rmse);
  return errors;
}

}  // namespace mesorig::btf
