#include "protocol/plan/read_directions.h"

#include <algorithm>
#include <cmath>

#include "protocol/plan/fits_rig.h"

namespace mesorig {
namespace {

constexpr double kAngleTolerance = 1e-12;  // rad: degrees in files are decimal
constexpr size_t kMaxAngles = 100'000;

// Another whole number of turns, within the axis' limits.
std::string SameDirection(const Axis& axis, double degrees) {
  for (double other = degrees - 360 * std::floor(degrees / 360) - 3600; other <= 3600;
       other += 360) {
    const double rad = RadFromDeg(other);
    if (rad >= axis.min_rad && rad <= axis.max_rad) {
      return fmt::format("; {:g} deg is the same direction", other);
    }
  }
  return "";
}

// Within the limits, or an error that tells why not. `low` and `high` are the ends of the whole
// list that the angle is one of.
double Limited(TomlTable& t, std::string_view key, const Axis& axis, double degrees, double low,
               double high) {
  const double rad = RadFromDeg(degrees);
  if (rad >= axis.min_rad - kAngleTolerance && rad <= axis.max_rad + kAngleTolerance) {
    // A limit that is written as the same number must hold exactly.
    return std::clamp(rad, axis.min_rad, axis.max_rad);
  }
  const double range = DegFromRad(axis.max_rad - axis.min_rad);
  std::string why = SameDirection(axis, degrees);
  if (high - low > range + 1e-9) {
    why = fmt::format(
        "; cable wrap: from {:g} to {:g} deg is a turn of {:g} deg, the axis has {:g}{}", low, high,
        high - low, range, why);
  }
  t.Error(key,
          fmt::format("turns axis {} to {:g} deg, its limits are {:g} to {:g} deg{}", axis.name,
                      degrees, DegFromRad(axis.min_rad), DegFromRad(axis.max_rad), why));
  return 0;
}

std::vector<double> ReadAngles(TomlTable t, const Axis& axis) {
  std::vector<double> degrees;
  const bool listed = t.Has("angles_deg");
  if (listed) {
    degrees = t.Numbers("angles_deg", {-1e5, 1e5});
  } else {
    const double start = t.Number("start_deg", {-1e5, 1e5});
    const double step = t.NumberOr("step_deg", 0, {-1e5, 1e5});
    const auto count = t.Integer("count", {1, static_cast<double>(kMaxAngles)});
    for (int64_t i = 0; i < count; ++i) degrees.push_back(start + static_cast<double>(i) * step);
  }
  const std::string_view key = listed ? "angles_deg" : "start_deg";
  if (degrees.empty()) {
    if (listed) t.Error(key, "is empty");
    return {};
  }
  std::sort(degrees.begin(), degrees.end());
  std::vector<double> angles;
  for (const double a : degrees) {
    angles.push_back(Limited(t, key, axis, a, degrees.front(), degrees.back()));
    // (Of a first angle beyond the limits, one error is enough.)
    if (angles.size() > 1 && angles.back() <= angles[angles.size() - 2]) {
      t.Error(key, fmt::format("has axis {} at {:g} deg twice: `repeats` takes shots again",
                               axis.name, a));
      return {};
    }
  }
  return angles;
}

template <typename Find, typename Items>
std::vector<int> ReadNames(TomlTable& t, std::string_view key, const Items& items, Find find) {
  std::vector<int> indices;
  if (!t.Has(key)) {  // all
    for (size_t i = 0; i < items.size(); ++i) indices.push_back(static_cast<int>(i));
    return indices;
  }
  for (const std::string& name : t.Strings(key)) {
    const std::optional<int> index = find(name);
    if (!index) {
      t.Error(key, fmt::format("names \"{}\", which the rig does not have", name));
    } else if (std::find(indices.begin(), indices.end(), *index) != indices.end()) {
      t.Error(key, fmt::format("names \"{}\" twice", name));
    } else {
      indices.push_back(*index);
    }
  }
  std::sort(indices.begin(), indices.end());
  if (indices.empty()) t.Error(key, "is empty");
  return indices;
}

// Whole half periods within [low, high] next to an exposure: "0.02 or 0.03 s".
std::string NearestHalfPeriods(double exposure_s, double half_s, double low_s, double high_s) {
  const double below = std::floor(exposure_s / half_s) * half_s, above = below + half_s;
  std::string text;
  for (const double e : {below, above}) {
    if (e < std::max(low_s, half_s / 2) || e > high_s * (1 + 1e-9)) continue;
    text += fmt::format("{}{:g}", text.empty() ? "" : " or ", e);
  }
  return text.empty() ? "none that the camera can do" : text + " s";
}

// What all of these cameras can do.
std::pair<double, double> ExposureLimits(const Rig& rig, const std::vector<int>& cameras) {
  double low = 0, high = 1e300;
  for (const int c : cameras) {
    low = std::max(low, rig.cameras[c].min_exposure_s);
    high = std::min(high, rig.cameras[c].max_exposure_s);
  }
  return {low, high};
}

// From the shortest on, each twice the one before, and the longest.
std::vector<double> DoublingLadder(double low, double high, const Rig& rig) {
  std::vector<double> ladder;
  const double half_s = rig.mains_hz > 0 ? 1 / (2 * rig.mains_hz) : 0;
  if (half_s > 0) {
    low = std::ceil(low / half_s - 1e-9) * half_s;
    high = std::floor(high / half_s + 1e-9) * half_s;
    low = std::max(low, half_s);
  }
  for (double e = low; e > 0 && e <= high && ladder.size() < kMaxLadder - 1; e *= 2) {
    ladder.push_back(e);
  }
  if (!ladder.empty() && high > ladder.back() * 1.01) ladder.push_back(high);
  return ladder;
}

std::vector<double> ReadLadder(TomlTable& t, const Rig& rig, const std::vector<int>& cameras) {
  if (t.Word("exposure", {"auto"}) != "auto") return {};
  if (t.Has("ladder_s")) {
    std::vector<double> ladder = t.Numbers("ladder_s", {1e-9, 1e6});
    std::sort(ladder.begin(), ladder.end());
    CheckExposureCount(t, "ladder_s", ladder);
    for (const double e : ladder) CheckExposure(t, "ladder_s", e, rig, cameras, true);
    return ladder;
  }
  const auto [low, high] = ExposureLimits(rig, cameras);
  const double from = t.NumberOr("exposure_min_s", low, {low, high});
  const double to = t.NumberOr("exposure_max_s", high, {low, high});
  const std::vector<double> ladder = DoublingLadder(from, to, rig);
  if (ladder.empty()) {
    t.Error("exposure",
            fmt::format("\"auto\": no exposure from {:g} to {:g} s that the cameras can "
                        "do is a whole half period of the mains ({:g} Hz)",
                        from, to, rig.mains_hz));
  }
  return ladder;
}

}  // namespace

std::vector<std::vector<double>> ReadAxes(TomlTable& t, const Rig& rig) {
  std::vector<std::vector<double>> angles;
  TomlTable axes = t.Table("axes");
  for (const Axis& axis : rig.axes) angles.push_back(ReadAngles(axes.Table(axis.name), axis));
  return angles;
}

std::vector<double> ReadAxesAngles(TomlTable& t, const Rig& rig) {
  std::vector<double> angles;
  TomlTable axes = t.Table("axes_deg");
  for (const Axis& axis : rig.axes) {
    const double degrees = axes.Number(axis.name, {-1e5, 1e5});
    // Home is where every run begins: a turn from there.
    angles.push_back(
        Limited(axes, axis.name, axis, degrees, std::min(0.0, degrees), std::max(0.0, degrees)));
  }
  return angles;
}

std::vector<int> ReadLamps(TomlTable& t, const Rig& rig) {
  return ReadNames(t, "lamps", rig.lamps, [&](auto& n) { return rig.FindLamp(n); });
}
std::vector<int> ReadCameras(TomlTable& t, const Rig& rig) {
  return ReadNames(t, "cameras", rig.cameras, [&](auto& n) { return rig.FindCamera(n); });
}
std::vector<int> ReadMounts(TomlTable& t, const Rig& rig) {
  return ReadNames(t, "mounts", rig.laser->mounts, [&](auto& n) { return rig.FindMount(n); });
}

void CheckExposure(TomlTable& t, std::string_view key, double exposure_s, const Rig& rig,
                   const std::vector<int>& cameras, bool under_lamps) {
  for (const int c : cameras) {
    const Camera& camera = rig.cameras[c];
    if (exposure_s >= camera.min_exposure_s && exposure_s <= camera.max_exposure_s) continue;
    t.Error(key, fmt::format("is {:g} s, camera {} does {:g} to {:g} s", exposure_s, camera.name,
                             camera.min_exposure_s, camera.max_exposure_s));
    return;
  }
  if (!under_lamps || rig.mains_hz <= 0) return;
  const double half_s = 1 / (2 * rig.mains_hz);
  const double periods = exposure_s / half_s;
  if (std::round(periods) >= 1 && std::abs(periods - std::round(periods)) <= 1e-6 * periods) return;
  const auto [low, high] = ExposureLimits(rig, cameras);
  t.Error(key, fmt::format("is {:g} s; lamps flicker at {:g} Hz mains, so exposures under them are "
                           "whole half periods of {:g} s; the nearest: {}",
                           exposure_s, rig.mains_hz, half_s,
                           NearestHalfPeriods(exposure_s, half_s, low, high)));
}

Exposures ReadExposures(TomlTable& t, const Rig& rig, const std::vector<int>& cameras) {
  Exposures exposures;
  const bool one = t.Has("exposure_s"), bracket = t.Has("exposures_s"), metered = t.Has("exposure");
  if (one + bracket + metered != 1) {
    t.Error("", R"(one of exposure_s, exposures_s and exposure = "auto" is needed)");
    return exposures;
  }
  if (metered) {
    exposures.ladder_s = ReadLadder(t, rig, cameras);
    return exposures;
  }
  const char* key = one ? "exposure_s" : "exposures_s";
  exposures.bracket_s = one ? std::vector<double>{t.Number(key)} : t.Numbers(key, {1e-9, 1e6});
  std::sort(exposures.bracket_s.begin(), exposures.bracket_s.end());
  CheckExposureCount(t, key, exposures.bracket_s);
  for (const double e : exposures.bracket_s) CheckExposure(t, key, e, rig, cameras, true);
  return exposures;
}

void CheckExposureCount(TomlTable& t, std::string_view key,
                        const std::vector<double>& exposures_s) {
  if (exposures_s.empty() || exposures_s.size() > kMaxLadder) {
    t.Error(key,
            fmt::format("has {} exposures, permitted is 1 to {}", exposures_s.size(), kMaxLadder));
  }
  const auto twice = std::adjacent_find(exposures_s.begin(), exposures_s.end());
  if (twice == exposures_s.end()) return;
  t.Error(key, fmt::format("has {:g} s twice: `repeats` takes shots again", *twice));
}

double ReadSettle(TomlTable& t) { return t.NumberOr("settle_s", 0, {0, kMaxSettle_s}); }
uint32_t ReadRepeats(TomlTable& t) {
  return static_cast<uint32_t>(t.IntegerOr("repeats", 1, {1, 1000}));
}

}  // namespace mesorig
