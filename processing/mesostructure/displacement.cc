#include "processing/mesostructure/displacement.h"

#include <algorithm>
#include <cmath>

#include "processing/mesostructure/gaussian_peak.h"
#include "processing/mesostructure/pixel_peak.h"
#include "processing/mesostructure/surface_image.h"

namespace mesorig::mesostructure {
namespace {

constexpr double kNothingBelow = 0.05, kAllFrom = 0.17;  // |sheet normal . ray|: 3 and 10 degrees
constexpr double kSureDistance_mm = 0.2;
constexpr double kAboveReference_mm = 0.3, kBelowTurntable_mm = 0.5;  // noise that is believed
constexpr double kDimmest = 0.03;  // of the median peak: light that came by way of other relief

// One pixel's point. `peak` for the comparison with the others.
struct SeenPoint {
  SurfacePoint point;
  double electrons = 0;
};

class PointFinder {
 public:
  PointFinder(const SweepGeometry& geometry, const Product& product, const CodeScale& scale,
              double sheet_fwhm_mm, std::span<const std::optional<TiltFix>> tilts)
      : geometry_(geometry),
        product_(product),
        scale_(scale),
        sigma_mm_(sheet_fwhm_mm / kFwhmPerSigma),
        tilts_(tilts),
        tetrahedron_(geometry.TetrahedronWeight()) {
    double sum = 0, count = 0;
    for (const auto& tilt : tilts) {
      if (tilt) sum += tilt->variance, count += 1;
    }
    tilt_variance_ = count > 0 ? sum / count : 0;
  }

  std::optional<SeenPoint> Find(uint32_t pixel, std::span<const uint16_t> series) {
    const int width = geometry_.region().width;
    const Vec3 ray = geometry_.Ray(
        {static_cast<int>(pixel) % width + 0.5, static_cast<int>(pixel) / width + 0.5});
    const double radius = DistanceFromAxis(geometry_.OnPlane(ray, 0.5 * product_.h_ref_mm));
    Collect(series);
    const auto peak = FindPixelPeak(samples_, {scale_.read_noise_e, sigma_mm_ / radius});
    if (!peak) return std::nullopt;
    return PointOf(ray, radius, *peak);
  }

 private:
  double DistanceFromAxis(Vec3 p) const {
    const Vec3 d = p - geometry_.laser().source;
    return std::max(Norm(d - Dot(d, geometry_.laser().axis) * geometry_.laser().axis), 1e-3);
  }

  void Collect(std::span<const uint16_t> series) {
    samples_.clear();
    for (size_t k = 0; k < series.size(); ++k) {
      if (!tilts_[k] || series[k] == FrameStack::kNothing) continue;
      const double electrons = (series[k] - scale_.black) * scale_.electrons_per_code;
      samples_.push_back(
          {tilts_[k]->tilt_rad, static_cast<float>(electrons), series[k] >= scale_.saturated});
    }
  }

  std::optional<SeenPoint> PointOf(Vec3 ray, double radius, const PixelPeak& peak) const {
    const LaserPose& laser = geometry_.laser();
    const Vec3 normal = SheetNormal(laser, peak.tilt_rad);
    const double across = Dot(normal, ray);
    // A ray in the sheet meets it everywhere.
    if (!(std::abs(across) > kNothingBelow)) return std::nullopt;
    const Vec3 camera = geometry_.camera_position();
    const double way = Dot(normal, laser.source - camera) / across;
    const Vec3 p = camera + way * ray;
    const bool believed = way > 0 && p.z <= product_.h_ref_mm + kAboveReference_mm &&
                          p.z >= -kBelowTurntable_mm && std::isfinite(p.x) && std::isfinite(p.y);
    if (!believed) return std::nullopt;
    // docs/laser.md, step 5: along the nominal direction.
    const Vec3 v = geometry_.view();
    const double distance = std::max((product_.h_ref_mm - p.z) / v.z, 0.0);
    const double deviation =
        std::sqrt(peak.variance + tilt_variance_) * radius / std::abs(across) / kSureDistance_mm;
    const double fade =
        std::clamp((std::abs(across) - kNothingBelow) / (kAllFrom - kNothingBelow), 0.0, 1.0);
    const double weight = tetrahedron_ * peak.quality * fade / (1 + deviation * deviation);
    if (!(weight > 1e-4)) return std::nullopt;
    return SeenPoint{{p.x + distance * v.x, p.y + distance * v.y, distance, weight},
                     peak.electrons};
  }

  const SweepGeometry& geometry_;
  const Product& product_;
  const CodeScale& scale_;
  const double sigma_mm_;
  const std::span<const std::optional<TiltFix>> tilts_;
  const double tetrahedron_;
  double tilt_variance_ = 0;
  std::vector<PixelSample> samples_;
};

// Where four pixels meet: their mean, weighted, if they lie on one surface. On a Bayer sensor two
// of them have the laser's colour, so that every corner has a point.
SurfacePoint Corner(std::span<const SurfacePoint* const> pixels) {
  SurfacePoint mean;
  double nearest = 0, farthest = 0, count = 0;
  for (const SurfacePoint* p : pixels) {
    if (!(p->weight > 0)) continue;
    if (count == 0) nearest = farthest = p->distance;
    nearest = std::min(nearest, p->distance), farthest = std::max(farthest, p->distance);
    mean.x += p->weight * p->x, mean.y += p->weight * p->y;
    mean.distance += p->weight * p->distance, mean.weight += p->weight;
    count += 1;
  }
  if (count == 0) return mean;
  mean.x /= mean.weight, mean.y /= mean.weight, mean.distance /= mean.weight;
  mean.weight /= count;
  double extent = 0;
  for (const SurfacePoint* p : pixels) {
    if (p->weight > 0) extent = std::max(extent, 2 * std::hypot(p->x - mean.x, p->y - mean.y));
  }
  if (farthest - nearest > kStep_mm + kSteepest * extent) mean.weight = 0;
  return mean;
}

std::vector<SurfacePoint> Corners(const std::vector<SurfacePoint>& pixels, int columns, int rows) {
  std::vector<SurfacePoint> corners;
  corners.reserve(pixels.size());
  for (int j = 0; j + 1 < rows; ++j) {
    for (int i = 0; i + 1 < columns; ++i) {
      const SurfacePoint* p = pixels.data() + static_cast<ptrdiff_t>(j) * columns + i;
      const SurfacePoint* const four[4] = {p, p + 1, p + columns, p + columns + 1};
      corners.push_back(Corner(four));
    }
  }
  return corners;
}

void DropDim(const std::vector<double>& electrons, std::vector<SurfacePoint>& points) {
  std::vector<double> peaks;
  for (size_t k = 0; k < points.size(); ++k) {
    if (points[k].weight > 0) peaks.push_back(electrons[k]);
  }
  if (peaks.empty()) return;
  const auto middle = peaks.begin() + static_cast<std::ptrdiff_t>(peaks.size() / 2);
  std::nth_element(peaks.begin(), middle, peaks.end());
  for (size_t k = 0; k < points.size(); ++k) {
    if (electrons[k] < kDimmest * *middle) points[k].weight = 0;
  }
}

}  // namespace

btf::MdfHeader DisplacementHeader(const SweepGeometry& geometry, const Product& product) {
  btf::MdfHeader header;
  header.width = product.width_px, header.height = product.height_px;
  header.pitch_mm = product.pitch_mm, header.h_ref_mm = product.h_ref_mm;
  header.views = {geometry.view()};
  header.view_positions_mm = {geometry.camera_position()};
  return header;
}

StatusOr<Displacement> ComputeDisplacement(const SweepGeometry& geometry, const Product& product,
                                           const CodeScale& scale, double sheet_fwhm_mm,
                                           const FrameStack& stack,
                                           std::span<const std::optional<TiltFix>> fixes) {
  const std::vector<std::optional<TiltFix>> tilts = CompleteTilts(fixes);
  Displacement result;
  for (size_t k = 0; k < tilts.size(); ++k) {
    if (!tilts[k]) continue;
    ++(fixes[k] ? result.figures.frames_with_tilt : result.figures.frames_bridged);
  }
  if (result.figures.frames_with_tilt < 3) {
    return FailedPrecondition("{} of {} frames show where the sheet stands, at least 3 are needed",
                              result.figures.frames_with_tilt, fixes.size());
  }
  const int columns = geometry.region().width, rows = geometry.region().height;
  std::vector<SurfacePoint> pixels(static_cast<size_t>(columns) * static_cast<size_t>(rows));
  std::vector<double> electrons(pixels.size());
  PointFinder finder(geometry, product, scale, sheet_fwhm_mm, tilts);
  for (size_t k = 0; k < geometry.sample().size(); ++k) {
    const uint32_t pixel = geometry.sample()[k];
    const auto seen = finder.Find(pixel, stack.Series(k));
    if (!seen) continue;
    pixels[pixel] = seen->point, electrons[pixel] = seen->electrons;
    ++result.figures.peaks;
  }
  result.figures.pixels = static_cast<uint32_t>(geometry.sample().size());
  DropDim(electrons, pixels);
  result.mdf = btf::Mdf(DisplacementHeader(geometry, product));
  const std::vector<SurfacePoint> corners = Corners(pixels, columns, rows);
  DrawSurface(corners, columns - 1, rows - 1, product, result.mdf.MutableDistance(0),
              result.mdf.MutableConfidence(0));
  for (const float weight : result.mdf.Confidence(0)) result.figures.texels += weight > 0 ? 1 : 0;
  return result;
}

}  // namespace mesorig::mesostructure
