#include "simulator/world/camera_image.h"

#include <algorithm>
#include <cmath>

#include "simulator/world/parallel.h"
#include "simulator/world/strata.h"

namespace mesorig::world {
namespace {

constexpr double kSquareMmPerSquareM = 1e6;

bool SamePose(const RigidTransform& a, const RigidTransform& b) {
  return a.rotation.m == b.rotation.m && a.translation == b.translation;
}

}  // namespace

int ChannelOfPixel(const Camera& camera, int i, int j) {
  if (camera.pattern == BayerPattern::kMono) return 1;
  return (i & 1) + (j & 1);  // R G / G B
}

Status CameraImages::Check(int camera, const RigState& state, double exposure_s,
                           const Region& region) const {
  if (camera < 0 || camera >= static_cast<int>(rig_.cameras.size())) {
    return InvalidArgument("camera {} of {}", camera, rig_.cameras.size());
  }
  if (state.axis_rad.size() != rig_.axes.size()) {
    return InvalidArgument("{} axis angles for {} axes", state.axis_rad.size(), rig_.axes.size());
  }
  for (size_t a = 0; a < rig_.axes.size(); ++a) {
    if (!std::isfinite(state.axis_rad[a])) {
      return InvalidArgument("{}: angle {} rad", rig_.axes[a].name, state.axis_rad[a]);
    }
  }
  if (state.lamp_levels.size() != rig_.lamps.size()) {
    return InvalidArgument("{} lamp levels for {} lamps", state.lamp_levels.size(),
                           rig_.lamps.size());
  }
  for (size_t l = 0; l < rig_.lamps.size(); ++l) {
    if (!(state.lamp_levels[l] >= 0 && state.lamp_levels[l] <= 1)) {
      return InvalidArgument("{}: level {} is not in 0..1", rig_.lamps[l].name,
                             state.lamp_levels[l]);
    }
  }
  if (!(exposure_s >= 0 && std::isfinite(exposure_s))) {
    return InvalidArgument("{}: exposure {} s", rig_.cameras[camera].name, exposure_s);
  }
  const Camera& c = rig_.cameras[camera];
  if (region.x < 0 || region.y < 0 || region.width <= 0 || region.height <= 0 ||
      region.width > c.width - region.x || region.height > c.height - region.y) {
    return InvalidArgument("{}: a region of {} x {} at ({}, {}) is not within {} x {}", c.name,
                           region.width, region.height, region.x, region.y, c.width, c.height);
  }
  return CheckLaser(state.laser);
}

Status CameraImages::CheckLaser(const LaserState& laser) const {
  if (laser.level == 0) return OkStatus();
  if (!rig_.laser) return InvalidArgument("rig {} has no laser", rig_.name);
  if (laser.mount < 0 || laser.mount >= static_cast<int>(rig_.laser->mounts.size())) {
    return InvalidArgument("{}: mount {} of {}", rig_.laser->name, laser.mount,
                           rig_.laser->mounts.size());
  }
  if (!(laser.level > 0 && laser.level <= 1)) {
    return InvalidArgument("{}: level {} is not in 0..1", rig_.laser->name, laser.level);
  }
  if (!std::isfinite(laser.tilt_rad)) {
    return InvalidArgument("{}: tilt {} rad", rig_.laser->name, laser.tilt_rad);
  }
  return OkStatus();
}

StatusOr<std::vector<float>> CameraImages::ExpectedElectrons(int camera, const RigState& state,
                                                             double exposure_s,
                                                             std::optional<Region> wanted) {
  Region region;
  if (wanted) {
    region = *wanted;
  } else if (camera >= 0 && camera < static_cast<int>(rig_.cameras.size())) {
    region = {0, 0, rig_.cameras[camera].width, rig_.cameras[camera].height};
  }
  MESORIG_RETURN_IF_ERROR(Check(camera, state, exposure_s, region));
  std::vector<float> electrons(static_cast<size_t>(region.width) *
                               static_cast<size_t>(region.height));
  const auto any_lamp = [&] {
    return std::any_of(state.lamp_levels.begin(), state.lamp_levels.end(),
                       [](double level) { return level > 0; });
  };
  if (any_lamp()) AddLamps(camera, state, exposure_s, region, electrons);
  if (state.laser.level > 0) AddLaser(camera, state, exposure_s, region, electrons);
  return electrons;
}

void CameraImages::AddLamps(int camera, const RigState& state, double exposure_s,
                            const Region& region, std::vector<float>& electrons) {
  const Camera& c = rig_.cameras[camera];
  const std::vector<double>& axis_rad = state.axis_rad;
  if (BlockedBy(rig_, WorldFromCamera(rig_, camera, axis_rad).translation, axis_rad)) return;
  for (int lamp = 0; lamp < static_cast<int>(rig_.lamps.size()); ++lamp) {
    if (state.lamp_levels[lamp] == 0) continue;
    if (BlockedBy(rig_, LampInWorld(rig_, lamp, axis_rad), axis_rad)) continue;
    const Picture& picture = PictureOf(camera, lamp, axis_rad);
    const double scale = state.lamp_levels[lamp] * c.electrons_per_radiance_s * exposure_s;
    float* out = electrons.data();
    for (int j = 0; j < region.height; ++j) {
      const float* row = picture.radiance.data() +
                         static_cast<size_t>(region.y + j) * static_cast<size_t>(c.width) +
                         region.x;
      for (int i = 0; i < region.width; ++i) *out++ += static_cast<float>(scale * row[i]);
    }
  }
}

void CameraImages::AddLaser(int camera, const RigState& state, double exposure_s,
                            const Region& region, std::vector<float>& electrons) {
  const double tilt = state.laser.tilt_rad;
  Sweep& sweep = SweepOf(camera, state.laser.mount, state.axis_rad);
  if (sweep.blocked) return;
  if (sweep.sheet->NeedsLight(tilt)) {
    const View& view = ViewOf(camera, SampleFromCamera(rig_, camera, state.axis_rad));
    laser_hits_lit_ += sweep.sheet->LightUp(world_, view.hits, tilt);
  }
  const double scale =
      state.laser.level * rig_.cameras[camera].electrons_per_radiance_s * exposure_s;
  sweep.sheet->Add(tilt, scale, region, electrons);
}

CameraImages::Sweep& CameraImages::SweepOf(int camera, int mount,
                                           const std::vector<double>& axis_rad) {
  for (auto it = sweeps_.begin(); it != sweeps_.end(); ++it) {
    if (it->camera == camera && it->mount == mount && it->axis_rad == axis_rad) {
      sweeps_.splice(sweeps_.begin(), sweeps_, it);
      return sweeps_.front();
    }
  }
  Sweep sweep{camera, mount, axis_rad, false, nullptr};
  sweep.blocked = BlockedBy(rig_, WorldFromCamera(rig_, camera, axis_rad).translation, axis_rad) ||
                  BlockedBy(rig_, LaserInWorld(rig_, mount, axis_rad).source, axis_rad);
  if (!sweep.blocked) {
    const View& view = ViewOf(camera, SampleFromCamera(rig_, camera, axis_rad));
    sweep.sheet = std::make_unique<LaserSheet>(rig_.cameras[camera], *rig_.laser,
                                               LaserInSample(rig_, mount, axis_rad), view.hits);
  }
  sweeps_.push_front(std::move(sweep));
  MakeRoom();
  return sweeps_.front();
}

const CameraImages::Picture& CameraImages::PictureOf(int camera, int lamp,
                                                     const std::vector<double>& axis_rad) {
  for (auto it = pictures_.begin(); it != pictures_.end(); ++it) {
    if (it->camera == camera && it->lamp == lamp && it->axis_rad == axis_rad) {
      pictures_.splice(pictures_.begin(), pictures_, it);
      return pictures_.front();
    }
  }
  const View& view = ViewOf(camera, SampleFromCamera(rig_, camera, axis_rad));
  const Camera& c = rig_.cameras[camera];
  const Light light{LampInSample(rig_, lamp, axis_rad), false};
  const auto& intensity = rig_.lamps[lamp].intensity_w_sr;
  const double per_sample =
      kSquareMmPerSquareM / (options_.samples_per_side * options_.samples_per_side);
  Picture picture{camera, lamp, axis_rad, {}};
  picture.radiance.resize(static_cast<size_t>(c.width) * static_cast<size_t>(c.height));
  ParallelFor(c.height, options_.threads, [&](int j) {
    Response response;
    for (const HitBlock& hits : view.hits.sample[j].blocks()) {
      Illuminate(world_, hits, light, 1, response);
      for (int k = 0; k < hits.count; ++k) {
        const unsigned i = hits.target[k];
        picture.radiance[static_cast<size_t>(j) * static_cast<size_t>(c.width) + i] +=
            static_cast<float>(per_sample * intensity[ChannelOfPixel(c, static_cast<int>(i), j)]) *
            response.value[0][k];
      }
    }
  });
  pictures_.push_front(std::move(picture));
  MakeRoom();
  return pictures_.front();
}

const CameraImages::View& CameraImages::ViewOf(int camera,
                                               const RigidTransform& sample_from_camera) {
  for (auto it = views_.begin(); it != views_.end(); ++it) {
    if (it->camera == camera && SamePose(it->sample_from_camera, sample_from_camera)) {
      views_.splice(views_.begin(), views_, it);
      return views_.front();
    }
  }
  views_.push_front(Trace(camera, sample_from_camera));
  return views_.front();
}

CameraImages::View CameraImages::Trace(int camera, const RigidTransform& sample_from_camera) const {
  const Camera& c = rig_.cameras[camera];
  View view{camera, sample_from_camera, {}, 0};
  view.hits.sample.resize(static_cast<size_t>(c.height));
  view.hits.turntable.resize(static_cast<size_t>(c.height));
  view.hits.samples_per_pixel = options_.samples_per_side * options_.samples_per_side;
  ParallelFor(c.height, options_.threads,
              [&](int j) { TraceRow(c, sample_from_camera, j, view.hits); });
  for (const auto* rows : {&view.hits.sample, &view.hits.turntable}) {
    for (const HitRow& row : *rows) view.bytes += row.bytes();
  }
  return view;
}

void CameraImages::TraceRow(const Camera& c, const RigidTransform& sample_from_camera, int j,
                            ViewHits& hits) const {
  const int n = options_.samples_per_side;
  const Vec3 origin = sample_from_camera.translation;
  Material plate;
  if (rig_.turntable) plate.diffuse.fill(rig_.turntable->albedo);
  for (int i = 0; i < c.width; ++i) {
    for (int s = 0; s < n * n; ++s) {
      const auto [du, dv] = StratumPoint(s, n);
      const Vec3 direction = sample_from_camera.rotation * RayDirection(c, {i + du, j + dv});
      const auto target = static_cast<unsigned>(i);
      if (const auto hit = world_.FirstHit(origin, direction)) {
        hits.sample[j].Add(*hit, -direction, target, ChannelOfPixel(c, i, j));
      } else if (rig_.laser && origin.z > 0 && direction.z < 0) {  // past the sample
        const Vec3 p = origin - (origin.z / direction.z) * direction;
        if (std::hypot(p.x, p.y) > rig_.turntable->radius_mm) continue;
        hits.turntable[j].Add({p, {0, 0, 1}, plate}, -direction, target, ChannelOfPixel(c, i, j));
      }
    }
  }
}

// Keeps what was used last; what is in front always stays.
void CameraImages::MakeRoom() {
  size_t bytes = 0;
  for (const View& view : views_) bytes += view.bytes;
  for (const Picture& picture : pictures_) bytes += picture.radiance.size() * sizeof(float);
  for (const Sweep& sweep : sweeps_) bytes += sweep.sheet ? sweep.sheet->bytes() : 0;
  while (bytes > options_.cache_bytes && pictures_.size() > 8) {
    bytes -= pictures_.back().radiance.size() * sizeof(float);
    pictures_.pop_back();
  }
  // A sweep is over before the next begins: those of the other cameras are all that is needed.
  while (sweeps_.size() > 2 * rig_.cameras.size() ||
         (bytes > options_.cache_bytes && sweeps_.size() > rig_.cameras.size())) {
    if (sweeps_.back().sheet) bytes -= sweeps_.back().sheet->bytes();
    sweeps_.pop_back();
  }
  while (bytes > options_.cache_bytes && views_.size() > 1) {
    bytes -= views_.back().bytes;
    views_.pop_back();
  }
}

}  // namespace mesorig::world
