#include "processing/btf/sampled_btf.h"

#include <algorithm>
#include <numeric>

#include "protocol/base/check.h"

namespace mesorig::btf {
namespace {

constexpr double kUnitTolerance = 1e-3;
constexpr double kUniqueTolerance = 1e-6;  // rad
constexpr double kMaxValues = 1099511627776.0;  // 2^40

bool IsFinite(Vec3 p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); }

// Sorted along x, only neighbours within the tolerance need to be compared.
Status CheckUnique(const std::vector<Vec3>& directions, std::string_view what) {
  std::vector<size_t> order(directions.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::sort(order.begin(), order.end(),
            [&](size_t a, size_t b) { return directions[a].x < directions[b].x; });
  for (size_t i = 0; i < order.size(); ++i) {
    const Vec3 a = directions[order[i]];
    for (size_t k = i + 1; k < order.size() && directions[order[k]].x - a.x < kUniqueTolerance;
         ++k) {
      if (Norm(directions[order[k]] - a) < kUniqueTolerance) {
        return InvalidArgument("{}s {} and {} are the same direction ({:.6f}, {:.6f}, {:.6f})",
                               what, std::min(order[i], order[k]), std::max(order[i], order[k]),
                               a.x, a.y, a.z);
      }
    }
  }
  return OkStatus();
}

Status CheckDirections(const std::vector<Vec3>& directions, const std::vector<Vec3>& positions,
                       std::string_view what) {
  if (directions.empty() || directions.size() > static_cast<size_t>(kMaxDirections)) {
    return InvalidArgument("{} {}s, permitted are 1 to {}", directions.size(), what,
                           kMaxDirections);
  }
  for (size_t i = 0; i < directions.size(); ++i) {
    if (!IsFinite(directions[i]) || std::abs(Norm(directions[i]) - 1) > kUnitTolerance) {
      return InvalidArgument("{} {} = ({}, {}, {}) is not a unit vector", what, i, directions[i].x,
                             directions[i].y, directions[i].z);
    }
  }
  if (!positions.empty() && positions.size() != directions.size()) {
    return InvalidArgument("{} {} positions for {} {}s", positions.size(), what, directions.size(),
                           what);
  }
  for (size_t i = 0; i < positions.size(); ++i) {
    if (!IsFinite(positions[i])) return InvalidArgument("{} position {} is not finite", what, i);
  }
  return CheckUnique(directions, what);
}

}  // namespace

Vec3 BtfHeader::ViewAt(int view, Vec3 p_in_sample) const {
  const auto at = static_cast<size_t>(view);
  if (view_positions_mm.empty()) return views[at];
  return Normalized(view_positions_mm[at] - p_in_sample);
}

Vec3 BtfHeader::LightAt(int light, Vec3 p_in_sample) const {
  const auto at = static_cast<size_t>(light);
  if (light_positions_mm.empty()) return lights[at];
  return Normalized(light_positions_mm[at] - p_in_sample);
}

Status CheckHeader(const BtfHeader& header) {
  if (header.width < 1 || header.width > kMaxSize || header.height < 1 ||
      header.height > kMaxSize) {
    return InvalidArgument("size {} x {} texels, each must be in [1, {}]", header.width,
                           header.height, kMaxSize);
  }
  MESORIG_RETURN_IF_ERROR(CheckDirections(header.views, header.view_positions_mm, "view"));
  MESORIG_RETURN_IF_ERROR(CheckDirections(header.lights, header.light_positions_mm, "light"));
  const double values = 3.0 * header.width * header.height *
                        static_cast<double>(header.views.size()) *
                        static_cast<double>(header.lights.size());
  if (values > kMaxValues) {
    return InvalidArgument("{} x {} texels x {} views x {} lights: more than 2^40 values",
                           header.width, header.height, header.views.size(),
                           header.lights.size());
  }
  if (!std::isfinite(header.pitch_mm) || header.pitch_mm < 0) {
    return InvalidArgument("pitch {} mm is not a finite length >= 0", header.pitch_mm);
  }
  if (!std::isfinite(header.h_ref_mm)) {
    return InvalidArgument("h_ref {} mm is not finite", header.h_ref_mm);
  }
  if (!header.mask.empty() && header.mask.size() != header.texel_count()) {
    return InvalidArgument("mask of {} texels for {} x {}", header.mask.size(), header.width,
                           header.height);
  }
  return OkStatus();
}

SampledBtf::SampledBtf(BtfHeader header) : header_(std::move(header)) {
  MESORIG_CHECK(CheckHeader(header_).ok());
  const size_t pairs = header_.views.size() * header_.lights.size();
  present_.assign(pairs, 0);
  values_.assign(pairs * image_size(), 0.0f);
}

size_t SampledBtf::present_count() const {
  return static_cast<size_t>(std::count_if(present_.begin(), present_.end(),
                                           [](uint8_t flag) { return flag != 0; }));
}

}  // namespace mesorig::btf
