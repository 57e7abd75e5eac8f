#include "processing/report/errors_by_angle.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace mesorig::report {
namespace {

constexpr double kRing = RadFromDeg(1);

struct Rings {
  std::vector<size_t> of;        // for each direction
  std::vector<double> theta_rad;  // means, ascending
};

Rings RingsOf(const std::vector<Vec3>& directions) {
  std::vector<double> theta;
  for (const Vec3& d : directions) theta.push_back(AnglesFromDirection(Normalized(d)).theta_rad);
  std::vector<size_t> order(theta.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t i, size_t j) { return theta[i] < theta[j]; });
  Rings rings;
  rings.of.resize(theta.size());
  double first = 0, sum = 0;
  size_t count = 0;
  for (const size_t k : order) {
    if (count == 0 || theta[k] - first >= kRing) {
      rings.theta_rad.push_back(0);
      first = theta[k], sum = 0, count = 0;
    }
    sum += theta[k], ++count;
    rings.theta_rad.back() = sum / static_cast<double>(count);
    rings.of[k] = rings.theta_rad.size() - 1;
  }
  return rings;
}

struct Sums {
  double difference = 0, reference = 0;
  size_t samples = 0, pairs = 0;
  void Add(const Sums& other) {
    difference += other.difference, reference += other.reference;
    samples += other.samples, pairs += other.pairs;
  }
};

Sums OfPair(const btf::BtfHeader& header, std::span<const float> a, std::span<const float> b) {
  Sums sums;
  sums.pairs = 1;
  for (size_t i = 0; i < a.size(); ++i) {
    if (!header.InMask(i / 3)) continue;
    const double y = b[i], difference = a[i] - y;
    sums.difference += difference * difference, sums.reference += y * y;
    ++sums.samples;
  }
  return sums;
}

std::vector<AngleErrors> Figures(const Rings& rings, const std::vector<Sums>& sums, double peak) {
  std::vector<AngleErrors> figures;
  for (size_t k = 0; k < sums.size(); ++k) {
    if (sums[k].samples == 0) continue;
    AngleErrors e;
    e.theta_deg = DegFromRad(rings.theta_rad[k]);
    e.rmse = std::sqrt(sums[k].difference / static_cast<double>(sums[k].samples));
    e.psnr_db = btf::PsnrDb(peak, e.rmse);
    if (sums[k].reference > 0) {
      e.rel_error = std::sqrt(sums[k].difference / sums[k].reference);
    } else {
      e.rel_error = sums[k].difference > 0 ? 1 : 0;
    }
    e.pairs = sums[k].pairs;
    figures.push_back(e);
  }
  return figures;
}

}  // namespace

StatusOr<ErrorsByAngleResult> ErrorsByAngle(const btf::SampledBtf& a,
                                            const btf::SampledBtf& reference) {
  // The same checks, and nothing that is not finite.
  MESORIG_RETURN_IF_ERROR(btf::CompareBtf(a, reference).status());
  const btf::BtfHeader& header = reference.header();
  const Rings views = RingsOf(header.views), lights = RingsOf(header.lights);
  std::vector<Sums> of_view(views.theta_rad.size()), of_light(lights.theta_rad.size());
  for (int v = 0; v < header.view_count(); ++v) {
    for (int l = 0; l < header.light_count(); ++l) {
      if (!a.Present(v, l) || !reference.Present(v, l)) continue;
      const Sums sums = OfPair(header, a.Image(v, l), reference.Image(v, l));
      of_view[views.of[static_cast<size_t>(v)]].Add(sums);
      of_light[lights.of[static_cast<size_t>(l)]].Add(sums);
    }
  }
  const double peak = btf::PsnrPeak(header);
  return ErrorsByAngleResult{Figures(views, of_view, peak), Figures(lights, of_light, peak)};
}

}  // namespace mesorig::report
