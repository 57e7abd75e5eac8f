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

Status CameraImages::Check(int camera, const RigState& state, double exposure_s) const {
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
  return OkStatus();
}

StatusOr<std::vector<float>> CameraImages::ExpectedElectrons(int camera, const RigState& state,
                                                             double exposure_s) {
  MESORIG_RETURN_IF_ERROR(Check(camera, state, exposure_s));
  const Camera& c = rig_.cameras[camera];
  const std::vector<double>& axis_rad = state.axis_rad;
  std::vector<float> electrons(static_cast<size_t>(c.width) * static_cast<size_t>(c.height));
  if (BlockedBy(rig_, WorldFromCamera(rig_, camera, axis_rad).translation, axis_rad)) {
    return electrons;
  }
  for (int lamp = 0; lamp < static_cast<int>(rig_.lamps.size()); ++lamp) {
    if (state.lamp_levels[lamp] == 0) continue;
    if (BlockedBy(rig_, LampInWorld(rig_, lamp, axis_rad), axis_rad)) continue;
    const Picture& picture = PictureOf(camera, lamp, axis_rad);
    const double scale = state.lamp_levels[lamp] * c.electrons_per_radiance_s * exposure_s;
    for (size_t i = 0; i < electrons.size(); ++i) {
      electrons[i] += static_cast<float>(scale * picture.radiance[i]);
    }
  }
  return electrons;
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
    for (const HitBlock& hits : view.rows[j].blocks()) {
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
  View view{camera, sample_from_camera, std::vector<HitRow>(static_cast<size_t>(c.height)), 0};
  const int n = options_.samples_per_side;
  ParallelFor(c.height, options_.threads, [&](int j) {
    for (int i = 0; i < c.width; ++i) {
      for (int s = 0; s < n * n; ++s) {
        const auto [du, dv] = StratumPoint(s, n);
        const ImagePoint at{i + du, j + dv};
        const Vec3 direction = sample_from_camera.rotation * RayDirection(c, at);
        const auto hit = world_.FirstHit(sample_from_camera.translation, direction);
        if (!hit) continue;
        view.rows[j].Add(*hit, -direction, static_cast<unsigned>(i), ChannelOfPixel(c, i, j));
      }
    }
  });
  for (const HitRow& row : view.rows) view.bytes += row.bytes();
  return view;
}

// Keeps what was used last; the view and the picture in front always stay.
void CameraImages::MakeRoom() {
  size_t bytes = 0;
  for (const View& view : views_) bytes += view.bytes;
  for (const Picture& picture : pictures_) bytes += picture.radiance.size() * sizeof(float);
  while (bytes > options_.cache_bytes && pictures_.size() > 8) {
    bytes -= pictures_.back().radiance.size() * sizeof(float);
    pictures_.pop_back();
  }
  while (bytes > options_.cache_bytes && views_.size() > 1) {
    bytes -= views_.back().bytes;
    views_.pop_back();
  }
}

}  // namespace mesorig::world
