#include "processing/mesostructure/tilt.h"

#include <algorithm>
#include <cmath>

namespace mesorig::mesostructure {
namespace {

constexpr double kStandOff = 1.0 / 3;  // of a step
constexpr double kSureness = 5;        // standard deviations
constexpr double kArm_px = 10;         // how far from the best point the direction is looked at

ImagePoint PointAt(const StripeLine& line, double along) {
  const double across = line.At(along);
  return line.profiles == Profiles::kRows ? ImagePoint{across, along} : ImagePoint{along, across};
}

// The angle between the line on the turntable and the pencil's axis, rad; nothing where the line
// leaves the turntable's side of the horizon.
std::optional<double> AngleToAxis(const SweepGeometry& geometry, const StripeLine& line) {
  const Vec3 a = geometry.Ray(PointAt(line, line.centre - kArm_px));
  const Vec3 b = geometry.Ray(PointAt(line, line.centre + kArm_px));
  if (!(a.z < -1e-3 && b.z < -1e-3)) return std::nullopt;
  const Vec3 along = Normalized(geometry.OnPlane(b, 0) - geometry.OnPlane(a, 0));
  const double angle = AngleBetween(along, geometry.laser().axis);
  return std::min(angle, kPi - angle);
}

size_t NextFix(std::span<const std::optional<TiltFix>> fixes, size_t from) {
  while (from < fixes.size() && !fixes[from]) ++from;
  return from;
}

double Interpolate(double t0, double t1, size_t k0, size_t k1, size_t k) {
  return t0 + (t1 - t0) * static_cast<double>(k - k0) / static_cast<double>(k1 - k0);
}

// How far the fix `k` stands off the line through two others, by what is allowed: more than 1 is
// too far. At the ends, where the line goes on beyond both, twice as much is allowed.
double StandOff(std::span<const std::optional<TiltFix>> fixes, size_t k, size_t a, size_t b) {
  const double t0 = fixes[a]->tilt_rad, t1 = fixes[b]->tilt_rad;
  const double way = static_cast<double>(b) - static_cast<double>(a);
  const double share = (static_cast<double>(k) - static_cast<double>(a)) / way;
  const double step = std::abs(t1 - t0) / way;
  const double deviation =
      std::sqrt(fixes[k]->variance + (1 - share) * (1 - share) * fixes[a]->variance +
                share * share * fixes[b]->variance);
  const bool beyond = share < 0 || share > 1;
  const double allowed = std::max((beyond ? 2 : 1) * kStandOff * step, kSureness * deviation);
  return std::abs(fixes[k]->tilt_rad - (t0 + share * (t1 - t0))) / std::max(allowed, 1e-12);
}

// Drops what stands off the line of its neighbours, the worst first.
void DropOutliers(std::vector<std::optional<TiltFix>>& fixes) {
  while (true) {
    std::vector<size_t> known;
    for (size_t k = NextFix(fixes, 0); k < fixes.size(); k = NextFix(fixes, k + 1)) {
      known.push_back(k);
    }
    const size_t count = known.size();
    if (count < 3) return;
    size_t worst = fixes.size();
    double most = 1;
    for (size_t i = 0; i < count; ++i) {
      const size_t a = i == 0 ? 1 : i - 1, b = i == 0 ? 2 : i + 1 == count ? i - 2 : i + 1;
      const double off = StandOff(fixes, known[i], known[std::min(a, b)], known[std::max(a, b)]);
      if (off > most) most = off, worst = known[i];
    }
    if (worst == fixes.size()) return;
    fixes[worst].reset();
  }
}

bool Monotone(std::span<const std::optional<TiltFix>> fixes) {
  int ups = 0, downs = 0;
  size_t before = NextFix(fixes, 0);
  for (size_t k = NextFix(fixes, before + 1); k < fixes.size(); k = NextFix(fixes, k + 1)) {
    const double moved = fixes[k]->tilt_rad - fixes[before]->tilt_rad;
    const double deviation = std::sqrt(fixes[k]->variance + fixes[before]->variance);
    if (moved > kSureness * deviation) ++ups;
    if (moved < -kSureness * deviation) ++downs;
    before = k;
  }
  return ups == 0 || downs == 0;
}

}  // namespace

StatusOr<TiltFix> FindTilt(const SweepGeometry& geometry, const StripeImage& image) {
  const StripeOptions options;
  const Profiles profiles = geometry.profiles();
  MESORIG_ASSIGN_OR_RETURN(const StripeLine line,
                           FitStripeLine(FindStripe(image, profiles, options), profiles, options));
  const Vec3 ray = geometry.Ray(PointAt(line, line.centre));
  const std::optional<double> angle = AngleToAxis(geometry, line);
  if (!(ray.z < -1e-3) || !angle) {
    return FailedPrecondition("the stripe's line passes the turntable's horizon");
  }
  const double angle_error = std::sqrt(line.slope_variance) / geometry.view().z;
  if (!(*angle <= kParallel + kSureness * angle_error)) {
    return FailedPrecondition("a line at {:.2f} degrees to the laser's axis, permitted are {:.2f}",
                              DegFromRad(*angle), DegFromRad(kParallel));
  }
  const LaserPose& laser = geometry.laser();
  TiltFix fix;
  fix.tilt_rad = TiltOfPoint(laser, geometry.OnPlane(ray, 0));
  // A pixel aside, across the stripe, tells what a pixel is worth.
  StripeLine aside = line;
  aside.position += 1;
  const Vec3 ray_aside = geometry.Ray(PointAt(aside, line.centre));
  if (!(ray_aside.z < -1e-3)) return FailedPrecondition("the stripe lies at the horizon");
  const double per_px = TiltOfPoint(laser, geometry.OnPlane(ray_aside, 0)) - fix.tilt_rad;
  fix.variance = per_px * per_px * line.position_variance;
  if (!std::isfinite(fix.tilt_rad) || !std::isfinite(fix.variance)) {
    return FailedPrecondition("the stripe's plane is not finite");
  }
  return fix;
}

std::vector<std::optional<TiltFix>> CompleteTilts(std::span<const std::optional<TiltFix>> fixes) {
  std::vector<std::optional<TiltFix>> tilts(fixes.begin(), fixes.end());
  const auto known = [](const auto& list) {
    return std::count_if(list.begin(), list.end(), [](const auto& t) { return t.has_value(); });
  };
  DropOutliers(tilts);
  if (!Monotone(tilts) || 3 * known(tilts) < 2 * known(fixes)) {
    std::fill(tilts.begin(), tilts.end(), std::nullopt);
    return tilts;
  }
  size_t before = NextFix(tilts, 0);
  for (size_t after = NextFix(tilts, before + 1); after < tilts.size();
       after = NextFix(tilts, after + 1)) {
    const TiltFix a = *tilts[before], b = *tilts[after];
    for (size_t k = before + 1; after - before <= kLongestGap + 1 && k < after; ++k) {
      // Bridged: no better known than a tenth of a step.
      const double tenth = 0.1 * (b.tilt_rad - a.tilt_rad) / static_cast<double>(after - before);
      tilts[k] = TiltFix{Interpolate(a.tilt_rad, b.tilt_rad, before, after, k),
                         a.variance + b.variance + tenth * tenth};
    }
    before = after;
  }
  return tilts;
}

}  // namespace mesorig::mesostructure
