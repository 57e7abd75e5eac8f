#include "simulator/world/laser_sheet.h"

#include <algorithm>
#include <cmath>

#include "simulator/world/camera_image.h"

namespace mesorig::world {
namespace {

constexpr double kFwhmPerSigma = 2.3548200450309493;  // 2 sqrt(2 ln 2)
constexpr double kSquareMmPerSquareM = 1e6;
// A bin is a quarter of sigma wide at the mean distance, but there are never more than so many.
constexpr double kBinsPerSigma = 4;
constexpr size_t kMostBins = 1u << 16;
// Hits nearer to the pencil's axis than this have no tilt to speak of.
constexpr double kLeastDistanceMm = 1;

}  // namespace

LaserSheet::LaserSheet(const Camera& camera, const Laser& laser, const LaserPose& pose_in_sample,
                       const ViewHits& hits)
    : camera_(camera),
      laser_(laser),
      pose_(pose_in_sample),
      sigma_mm_(laser.fwhm_mm / kFwhmPerSigma) {
  const Vec3 normal = Cross(pose_.axis, pose_.forward);
  const double widest = std::tan(laser.fan_rad / 2);
  std::vector<Hit> found;
  for (int j = 0; j < camera.height; ++j) {
    for (const uint32_t table : {0u, 1u}) {
      const HitRow& row = (table != 0 ? hits.turntable : hits.sample)[static_cast<size_t>(j)];
      for (uint32_t b = 0; b < row.blocks().size(); ++b) {
        const HitBlock& block = row.blocks()[b];
        for (uint32_t k = 0; k < static_cast<uint32_t>(block.count); ++k) {
          const Vec3 d = Vec3{block.x[k], block.y[k], block.z[k]} - pose_.source;
          const double ahead = Dot(d, normal), deep = Dot(d, pose_.forward);
          const double distance = std::hypot(ahead, deep);
          // Only what lies before the emitter, inside the fan.
          if (!(deep > 0 && distance > kLeastDistanceMm) ||
              std::abs(Dot(d, pose_.axis)) > widest * distance) {
            continue;
          }
          const auto pixel = static_cast<uint32_t>(j * camera.width) + block.target[k];
          found.push_back({pixel, b * 16 + k * 2 + table, static_cast<float>(ahead),
                           static_cast<float>(deep), 0});
        }
      }
    }
  }
  Sort(std::move(found));
}

void LaserSheet::Sort(std::vector<Hit> hits) {
  std::vector<float> tilts(hits.size());
  double low = kPi, high = -kPi, sum = 0;
  nearest_mm_ = 1e30;
  for (size_t i = 0; i < hits.size(); ++i) {
    tilts[i] = std::atan2(hits[i].ahead, hits[i].deep);
    low = std::min<double>(low, tilts[i]);
    high = std::max<double>(high, tilts[i]);
    const double distance = std::hypot(hits[i].ahead, hits[i].deep);
    nearest_mm_ = std::min(nearest_mm_, distance);
    sum += distance;
  }
  if (hits.empty()) low = high = nearest_mm_ = 0;
  tilt_low_ = low;
  const double mean = hits.empty() ? 1 : sum / static_cast<double>(hits.size());
  bin_rad_ = std::max(sigma_mm_ / kBinsPerSigma / mean, (high - low) / kMostBins);
  const auto bins = static_cast<size_t>((high - low) / bin_rad_) + 1;
  const auto bin_of = [&](size_t i) {
    return std::min(bins - 1, static_cast<size_t>((tilts[i] - low) / bin_rad_));
  };
  start_.assign(bins + 1, 0);
  for (size_t i = 0; i < hits.size(); ++i) ++start_[bin_of(i) + 1];
  for (size_t b = 0; b < bins; ++b) start_[b + 1] += start_[b];
  std::vector<uint32_t> next(start_.begin(), start_.end() - 1);
  hits_.resize(hits.size());
  for (size_t i = 0; i < hits.size(); ++i) hits_[next[bin_of(i)]++] = hits[i];
  lit_.assign(bins, 0);
}

LaserSheet::Bins LaserSheet::Near(double tilt_rad) const {
  const double tilt = std::remainder(tilt_rad, 2 * kPi);
  // The tilt between the sheet and a hit at distance r is asin(s / r).
  const double reach = kCutSigmas * sigma_mm_;
  const double width = reach < nearest_mm_ ? std::asin(reach / nearest_mm_) : kPi;
  const auto bin = [&](double t) {
    return static_cast<size_t>(
        std::clamp((t - tilt_low_) / bin_rad_, 0.0, static_cast<double>(lit_.size())));
  };
  return {bin(tilt - width), std::min(lit_.size(), bin(tilt + width) + 1)};
}

bool LaserSheet::NeedsLight(double tilt_rad) const {
  const Bins near = Near(tilt_rad);
  for (size_t b = near.first; b < near.last; ++b) {
    if (lit_[b] == 0 && start_[b] != start_[b + 1]) return true;
  }
  return false;
}

size_t LaserSheet::LightUp(const World& world, const ViewHits& view, double tilt_rad) {
  const Light light{pose_.source, false};
  // Response holds f_r cos / r^2: r of it and power / fan / (sigma sqrt(2 pi)) make the radiance.
  const double strength = kSquareMmPerSquareM * laser_.power_w / laser_.fan_rad /
                          (sigma_mm_ * std::sqrt(2 * kPi)) / view.samples_per_pixel;
  const auto block_of = [&](const Hit& hit) -> const HitBlock& {
    const auto row = hit.pixel / static_cast<uint32_t>(camera_.width);
    return ((hit.place & 1) != 0 ? view.turntable : view.sample)[row].blocks()[hit.place / 16];
  };
  size_t count = 0;
  const Bins near = Near(tilt_rad);
  for (size_t b = near.first; b < near.last; ++b) {
    if (lit_[b] != 0) continue;
    lit_[b] = 1;
    for (uint32_t i = start_[b]; i < start_[b + 1]; i += 8) {
      HitBlock block;
      const uint32_t end = std::min(i + 8, start_[b + 1]);
      for (uint32_t h = i; h < end; ++h) block.Copy(block_of(hits_[h]), hits_[h].place / 2 % 8);
      Response response;
      Illuminate(world, block, light, 1, response);
      for (uint32_t h = i; h < end; ++h) {
        Hit& hit = hits_[h];
        const auto k = h - i;
        const Vec3 d = Vec3{block.x[k], block.y[k], block.z[k]} - pose_.source;
        const int width = camera_.width, pixel = static_cast<int>(hit.pixel);
        const double seen = laser_.response[ChannelOfPixel(camera_, pixel % width, pixel / width)];
        hit.peak = static_cast<float>(strength * seen * Norm(d) * response.value[0][k]);
      }
      count += end - i;
    }
  }
  return count;
}

void LaserSheet::Add(double tilt_rad, double scale, const Region& region,
                     std::span<float> pixels) const {
  const auto c = static_cast<float>(std::cos(tilt_rad) / sigma_mm_);
  const auto s = static_cast<float>(std::sin(tilt_rad) / sigma_mm_);
  const auto factor = static_cast<float>(scale);
  constexpr auto kCut = static_cast<float>(kCutSigmas);
  const auto width = static_cast<uint32_t>(camera_.width);
  const Bins near = Near(tilt_rad);
  for (uint32_t h = start_[near.first]; h < start_[std::max(near.first, near.last)]; ++h) {
    const Hit& hit = hits_[h];
    const float sigmas = c * hit.ahead - s * hit.deep;
    if (!(std::abs(sigmas) < kCut) || hit.peak == 0) continue;
    const int x = static_cast<int>(hit.pixel % width) - region.x;
    const int y = static_cast<int>(hit.pixel / width) - region.y;
    if (x < 0 || y < 0 || x >= region.width || y >= region.height) continue;
    pixels[static_cast<size_t>(y) * static_cast<size_t>(region.width) + static_cast<size_t>(x)] +=
        factor * hit.peak * std::exp(-0.5f * sigmas * sigmas);
  }
}

}  // namespace mesorig::world
