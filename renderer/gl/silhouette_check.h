#pragma once
// The interval test of gl/silhouettes.h on the CPU, in double, by intersecting the pixel's ray with
// every triangle and inverting the Jacobian as a matrix: what the shaders add or lose.

#include <optional>
#include <vector>

#include "processing/btf/spherical_interpolation.h"
#include "renderer/gl/scene_renderer.h"
#include "renderer/gl/silhouettes.h"
#include "renderer/scene/mesh.h"

namespace mesorig::renderer {

// Immutable; reentrant. Borrows the MDF.
class CpuSilhouette {
 public:
  // Of one object of the scene, whatever its material.
  static StatusOr<CpuSilhouette> Create(const Scene& scene, size_t object, const btf::Mdf& mdf);

  struct Result {
    bool hit = false;
    int intervals = 0;     // of the ray inside the object
    int interval = -1;     // which of them is hit
    double distance = 0;   // mm from the eye to p_f of the interval that is hit
    double to_relief = 0;  // mm from p_f to the relief
    // The smallest |d_f + d_b - |p_f - p_b|| of the intervals that were tested, mm: how narrowly it
    // was decided. Infinite without intervals.
    double margin = 0;
  };
  // (x, y): pixels from the picture's top left corner.
  Result At(double x, double y) const;

 private:
  struct Triangle {
    std::array<Vec3, 3> p, normal, along_x, along_y;  // world
    std::array<std::array<double, 2>, 3> uv;
  };
  struct Crossing {
    double t = 0;
    bool front = false;
    double u = 0, v = 0, cosine = 0;
    Vec3 toward;
  };
  explicit CpuSilhouette(const btf::Mdf& mdf) : mdf_(&mdf) {}
  std::vector<Crossing> Crossings(Vec3 direction) const;
  Crossing Interpolate(const Triangle& triangle, double b, double c, Vec3 away, double t) const;
  double DepthBetween(double u, double v, const btf::DirectionWeights& views) const;
  double DistanceAlong(double u, double v, Vec3 toward) const;
  double Descend(const Crossing& from, const Crossing& other, double chord) const;

  const btf::Mdf* mdf_;
  std::optional<btf::DirectionInterpolator> views_;
  Scene scene_;
  double step_mm_ = 0;
  double x_mm_ = 0, y_mm_ = 0;  // of the sample a millimetre of the texture
  std::vector<Triangle> triangles_;
};

struct SilhouetteCheck {
  size_t pixels = 0;     // compared
  size_t differing = 0;  // hit on one side only
  // Of the differing ones the largest margin, mm: small where rounding decided.
  double worst_margin_mm = 0;
  double cpu_ms = 0;
};
// Compares at most `most` pixels, evenly spread over the picture, with `fragments` (Probe's of this
// scene). A pixel differs where an MDF object is seen that the CPU does not hit, or nothing is seen
// and the CPU hits one.
StatusOr<SilhouetteCheck> CompareSilhouettesWithCpu(const Scene& scene, const btf::Mdf& mdf,
                                                    const std::vector<Fragment>& fragments,
                                                    size_t most);

}  // namespace mesorig::renderer
