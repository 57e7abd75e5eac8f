#include "processing/btf/mdf_errors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace mesorig::btf {
namespace {

constexpr double kSameDirection = 1e-4;  // rad
constexpr double kSameLength = 1e-6;     // relative
constexpr double kRing = RadFromDeg(1);
// A camera at 60 degrees of its arc stands at 60.3 over the reference plane.
constexpr double kNominal = RadFromDeg(0.5);
// The plane's height is searched on at most so many texels, evenly spread, and judged on all.
constexpr size_t kSearchTexels = 1u << 17;
constexpr int kHeights = 128, kRefinements = 4;

struct TexelPair {
  float measured = 0, truth = 0;  // mm
  float per_mm = 0;               // 1 / v.z: D of a plane one mm below the reference plane
};

bool SameLength(double a, double b) { return std::abs(a - b) <= kSameLength * std::abs(b); }

Status CheckSame(const MdfHeader& a, const MdfHeader& b) {
  if (a.width != b.width || a.height != b.height || !SameLength(a.pitch_mm, b.pitch_mm) ||
      !SameLength(a.h_ref_mm, b.h_ref_mm)) {
    return InvalidArgument(
        "{} x {} texels of {} mm at {} mm, the truth has {} x {} of {} mm at {} mm", a.width,
        a.height, a.pitch_mm, a.h_ref_mm, b.width, b.height, b.pitch_mm, b.h_ref_mm);
  }
  if (a.views.size() != b.views.size()) {
    return InvalidArgument("{} views, the truth has {}", a.views.size(), b.views.size());
  }
  for (size_t v = 0; v < a.views.size(); ++v) {
    const double apart = AngleBetween(Normalized(a.views[v]), Normalized(b.views[v]));
    if (!(apart <= kSameDirection)) {
      return InvalidArgument("view {} stands {:.3g} degrees from that of the truth", v,
                             DegFromRad(apart));
    }
  }
  return OkStatus();
}

double MedianAbs(std::vector<float>& values) {
  for (float& value : values) value = std::abs(value);
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double PlaneMedian(const std::vector<TexelPair>& pairs, size_t stride, double depth_mm,
                   std::vector<float>& scratch) {
  scratch.clear();
  for (size_t k = 0; k < pairs.size(); k += stride) {
    scratch.push_back(static_cast<float>(depth_mm * pairs[k].per_mm) - pairs[k].truth);
  }
  return MedianAbs(scratch);
}

// The median has several minima in general: all heights of the relief are tried, then the
// neighbourhood of the best, ever finer.
double BestPlaneDepth(const std::vector<TexelPair>& pairs) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const TexelPair& pair : pairs) {
    const double depth = static_cast<double>(pair.truth) / static_cast<double>(pair.per_mm);
    low = std::min(low, depth), high = std::max(high, depth);
  }
  const size_t stride = (pairs.size() + kSearchTexels - 1) / kSearchTexels;
  std::vector<float> scratch;
  double best = low, best_median = std::numeric_limits<double>::infinity();
  double first = low, step = (high - low) / kHeights;
  for (int round = 0; round < kRefinements && step > 0; ++round) {
    for (int k = 0; k <= kHeights; ++k) {
      const double median = PlaneMedian(pairs, stride, first + k * step, scratch);
      if (median < best_median) best_median = median, best = first + k * step;
    }
    first = best - 2 * step, step *= 4.0 / kHeights;
  }
  return best;
}

// The texels of one view; those that have a truth are counted in `with_truth`.
void Collect(const Mdf& mdf, const Mdf& truth, int view, std::vector<TexelPair>& pairs,
             size_t& with_truth) {
  const auto d = mdf.Distance(view), c = mdf.Confidence(view);
  const auto true_d = truth.Distance(view), true_c = truth.Confidence(view);
  const auto per_mm = static_cast<float>(1 / truth.header().views[static_cast<size_t>(view)].z);
  for (size_t i = 0; i < d.size(); ++i) {
    if (!(true_c[i] > 0)) continue;
    ++with_truth;
    if (c[i] > 0) pairs.push_back({d[i], true_d[i], per_mm});
  }
}

MdfFigures FiguresOf(const std::vector<TexelPair>& pairs, size_t with_truth, int views) {
  MdfFigures figures;
  figures.views = views, figures.texels = pairs.size();
  if (pairs.empty()) return figures;
  std::vector<float> errors;
  double squares = 0;
  for (const TexelPair& pair : pairs) {
    errors.push_back(pair.measured - pair.truth);
    squares += static_cast<double>(errors.back()) * static_cast<double>(errors.back());
  }
  const auto count = static_cast<double>(pairs.size());
  figures.median_abs_mm = MedianAbs(errors);
  figures.rmse_mm = std::sqrt(squares / count);
  figures.coverage = count / static_cast<double>(with_truth);
  return figures;
}

}  // namespace

StatusOr<MdfErrors> CompareMdf(const Mdf& mdf, const Mdf& truth, double theta_limit_rad) {
  MESORIG_RETURN_IF_ERROR(CheckSame(mdf.header(), truth.header()));
  std::vector<std::pair<double, int>> views;  // theta, view
  for (int v = 0; v < truth.header().view_count(); ++v) {
    const Vec3 direction = Normalized(truth.header().views[static_cast<size_t>(v)]);
    const double theta = AnglesFromDirection(direction).theta_rad;
    views.emplace_back(theta, v);
  }
  std::sort(views.begin(), views.end());
  const double limit = theta_limit_rad + kNominal;
  if (views.front().first > limit) {
    return InvalidArgument("no view lies within {} degrees", DegFromRad(theta_limit_rad));
  }
  int counted = 0;
  MdfErrors errors;
  std::vector<TexelPair> all;
  size_t all_truth = 0;
  for (size_t first = 0, next = 0; first < views.size(); first = next) {
    std::vector<TexelPair> pairs;
    size_t with_truth = 0;
    double theta = 0;
    const bool within = views[first].first <= limit;
    for (; next < views.size() && views[next].first - views[first].first < kRing &&
           (views[next].first <= limit) == within;
         ++next) {
      Collect(mdf, truth, views[next].second, pairs, with_truth);
      theta += views[next].first;
    }
    MdfRing ring;
    static_cast<MdfFigures&>(ring) = FiguresOf(pairs, with_truth, static_cast<int>(next - first));
    ring.theta_deg = DegFromRad(theta / ring.views);
    errors.by_view_theta.push_back(ring);
    if (!within) continue;
    counted += ring.views;
    all.insert(all.end(), pairs.begin(), pairs.end());
    all_truth += with_truth;
  }
  if (all.empty()) {
    return InvalidArgument("nothing was measured within {} degrees: {} texels have a truth there",
                           DegFromRad(theta_limit_rad), all_truth);
  }
  static_cast<MdfFigures&>(errors) = FiguresOf(all, all_truth, counted);
  const double depth = BestPlaneDepth(all);
  std::vector<float> scratch;
  errors.best_plane_median_abs_mm = PlaneMedian(all, 1, depth, scratch);
  errors.best_plane_z_mm = truth.header().h_ref_mm - depth;
  return errors;
}

}  // namespace mesorig::btf
