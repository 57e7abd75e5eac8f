#include "processing/assemble/rectify_map.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "protocol/base/check.h"
#include "protocol/rig/rig_geometry.h"

namespace mesorig::assemble {
namespace {

constexpr int kLeastSamples = 3, kMostSamples = 32;  // a side of a texel

// Catmull-Rom (Keys 1981, a = -1/2): weights of the four samples around the fraction t.
std::array<double, 4> CubicWeights(double t) {
  return {0.5 * t * (-1 + t * (2 - t)), 0.5 * (2 + t * t * (3 * t - 5)),
          0.5 * t * (1 + t * (4 - 3 * t)), 0.5 * t * t * (t - 1)};
}

// Weights of one texel, gathered in a window of the image that grows with what is added.
class Window {
 public:
  void Clear(int left, int top, int right, int bottom) {
    left_ = left, top_ = top, width_ = right - left + 1;
    weights_.assign(static_cast<size_t>(width_) * static_cast<size_t>(bottom - top + 1), 0.0);
  }
  void Add(double u, double v, double weight) {
    const double column = std::floor(u - 0.5), row = std::floor(v - 0.5);
    const std::array<double, 4> across = CubicWeights(u - 0.5 - column);
    const std::array<double, 4> down = CubicWeights(v - 0.5 - row);
    const int x = static_cast<int>(column) - 1 - left_, y = static_cast<int>(row) - 1 - top_;
    for (int j = 0; j < 4; ++j) {
      double* line = weights_.data() + static_cast<size_t>(y + j) * static_cast<size_t>(width_) + x;
      for (int i = 0; i < 4; ++i) line[i] += weight * down[static_cast<size_t>(j)] * across[static_cast<size_t>(i)];
    }
  }
  void Append(int image_width, std::vector<uint32_t>& pixels, std::vector<float>& weights) const {
    for (size_t k = 0; k < weights_.size(); ++k) {
      if (std::abs(weights_[k]) < 1e-7) continue;
      const int column = left_ + static_cast<int>(k) % width_;
      const int row = top_ + static_cast<int>(k) / width_;
      pixels.push_back(static_cast<uint32_t>(row * image_width + column));
      weights.push_back(static_cast<float>(weights_[k]));
    }
  }

 private:
  int left_ = 0, top_ = 0, width_ = 0;
  std::vector<double> weights_;
};

// Projects points of the reference plane.
struct Projector {
  const Camera& camera;
  RigidTransform camera_from_sample;
  std::optional<ImagePoint> operator()(Vec3 p_in_sample) const {
    return Project(camera, camera_from_sample * p_in_sample);
  }
};

// Sub-samples a side: two a pixel of the texel's longest extent in the image.
int SamplesPerSide(const Projector& project, Vec3 centre, double pitch) {
  const auto a = project(centre), b = project(centre + Vec3{pitch, 0, 0}),
             c = project(centre + Vec3{0, pitch, 0});
  if (!a || !b || !c) return kLeastSamples;
  const double extent =
      std::max(std::hypot(b->u - a->u, b->v - a->v), std::hypot(c->u - a->u, c->v - a->v));
  if (!(extent < kMostSamples)) return kMostSamples;
  return std::clamp(static_cast<int>(std::ceil(2 * extent)), kLeastSamples, kMostSamples);
}

// The whole support of a lookup at the point lies within the image.
bool Supported(const Camera& camera, const ImagePoint& p) {
  return p.u >= 1.5 && p.u < camera.width - 1.5 && p.v >= 1.5 && p.v < camera.height - 1.5;
}

// The points of one texel; false when one of them is not seen.
bool ProjectTexel(const Projector& project, Vec3 centre, double pitch, int samples,
                  std::vector<ImagePoint>& points) {
  points.clear();
  for (int b = 0; b < samples; ++b) {
    for (int a = 0; a < samples; ++a) {
      const double x = (a + 0.5) / samples - 0.5, y = (b + 0.5) / samples - 0.5;
      const std::optional<ImagePoint> p = project(centre + Vec3{x * pitch, y * pitch, 0});
      if (!p || !Supported(project.camera, *p)) return false;
      points.push_back(*p);
    }
  }
  return true;
}

void Accumulate(const std::vector<ImagePoint>& points, Window& window) {
  double left = 1e9, right = -1e9, top = 1e9, bottom = -1e9;
  for (const ImagePoint& p : points) {
    left = std::min(left, p.u), right = std::max(right, p.u);
    top = std::min(top, p.v), bottom = std::max(bottom, p.v);
  }
  const auto floor_px = [](double x) { return static_cast<int>(std::floor(x - 0.5)); };
  window.Clear(floor_px(left) - 1, floor_px(top) - 1, floor_px(right) + 2, floor_px(bottom) + 2);
  for (const ImagePoint& p : points) window.Add(p.u, p.v, 1.0 / static_cast<double>(points.size()));
}

}  // namespace

StatusOr<RectifyMap> RectifyMap::Build(const Camera& camera,
                                       const RigidTransform& sample_from_camera,
                                       const btf::BtfHeader& grid) {
  if (!(sample_from_camera.translation.z > grid.h_ref_mm)) {
    return FailedPrecondition("camera {} stands at z = {} mm, the reference plane at {} mm",
                              camera.name, sample_from_camera.translation.z, grid.h_ref_mm);
  }
  const Projector project{camera, Inverse(sample_from_camera)};
  RectifyMap map;
  map.width_ = camera.width, map.height_ = camera.height;
  map.first_.reserve(grid.texel_count() + 1);
  map.first_.push_back(0);
  const int samples = SamplesPerSide(project, {0, 0, grid.h_ref_mm}, grid.pitch_mm);
  Window window;
  std::vector<ImagePoint> points;
  for (int j = 0; j < grid.height; ++j) {
    for (int i = 0; i < grid.width; ++i) {
      const Vec3 centre = grid.TexelCentre(i, j);
      if (!ProjectTexel(project, centre, grid.pitch_mm, samples, points)) {
        return FailedPrecondition("camera {} does not see all of texel ({}, {}) at ({}, {}) mm",
                                  camera.name, i, j, centre.x, centre.y);
      }
      Accumulate(points, window);
      window.Append(camera.width, map.pixel_, map.weight_);
      map.first_.push_back(static_cast<uint32_t>(map.pixel_.size()));
    }
  }
  return map;
}

size_t RectifyMap::Apply(const image::RgbImage& image, std::span<float> texel_rgb,
                         std::span<uint8_t> saturated_texels) const {
  MESORIG_CHECK(saturated_texels.empty() || saturated_texels.size() == texel_count());
  MESORIG_CHECK(image.width == width_ && image.height == height_);
  MESORIG_CHECK(texel_rgb.size() == 3 * texel_count());
  size_t clipped = 0;
  for (size_t t = 0; t < texel_count(); ++t) {
    float red = 0, green = 0, blue = 0;
    bool saturated = false;
    for (uint32_t k = first_[t]; k < first_[t + 1]; ++k) {
      const float* rgb = image.rgb.data() + 3 * static_cast<size_t>(pixel_[k]);
      red += weight_[k] * rgb[0];
      green += weight_[k] * rgb[1];
      blue += weight_[k] * rgb[2];
      if (!image.saturated.empty()) saturated = saturated || image.saturated[pixel_[k]] != 0;
    }
    float* out = texel_rgb.data() + 3 * t;
    out[0] = red, out[1] = green, out[2] = blue;
    clipped += saturated ? 1 : 0;
    if (!saturated_texels.empty()) saturated_texels[t] = saturated ? 1 : 0;
  }
  return clipped;
}

}  // namespace mesorig::assemble
