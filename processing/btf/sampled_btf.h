#pragma once
// A sampled bidirectional texture function: linear RGB at W x H texels for every pair of measured
// view and light directions, as captured, before any compression.
//
// Value (DESIGN, "BTF value"): radiance towards v per unit irradiance of a plane perpendicular to
// l, f_r * cos(theta_l), sr^-1: the cosine of the light is inside. Directions are unit vectors in
// the sample frame that point away from the surface. Texel (0, 0) is top left, rows grow towards
// -y: texel (i, j) has its centre at ((i + 1/2 - W/2) pitch, (H/2 - j - 1/2) pitch, h_ref).

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"

namespace mesorig::btf {

// What a BTF is a BTF of, without its values. Codecs keep it too.
struct BtfHeader {
  int width = 0, height = 0;           // texels
  double pitch_mm = 0;                 // texel spacing on the reference plane; 0: unknown (photographs)
  double h_ref_mm = 0;                 // height of the reference plane in the sample frame
  std::vector<Vec3> views, lights;     // unit vectors, unique
  // Where the camera / lamp stood in the sample frame, mm; empty when at infinity or unknown. The
  // direction that texel p really had is Normalized(position - p); see ViewAt and LightAt.
  std::vector<Vec3> view_positions_mm, light_positions_mm;
  // W*H, row by row from the top; 1 where the texel shows the sample, 0 where it shows something
  // else (photographs with a mask). Empty: every texel does. Errors are counted inside it.
  std::vector<uint8_t> mask;
  bool cosine_included = true;
  bool calibrated = true;              // false: relative code values, not sr^-1
  std::string primaries = "rig";       // colour primaries: "rig" (camera's own) or "rec709"
  std::string provenance_json = "{}";  // digests of rig and plan, session, program version

  int view_count() const { return static_cast<int>(views.size()); }
  int light_count() const { return static_cast<int>(lights.size()); }
  size_t texel_count() const { return static_cast<size_t>(width) * static_cast<size_t>(height); }
  bool InMask(size_t texel) const { return mask.empty() || mask[texel] != 0; }
  // Centre of texel (i, j) on the reference plane, mm, sample frame.
  Vec3 TexelCentre(int i, int j) const {
    return {(i + 0.5 - width / 2.0) * pitch_mm, (height / 2.0 - j - 0.5) * pitch_mm, h_ref_mm};
  }
  // The direction that the texel at p really had.
  Vec3 ViewAt(int view, Vec3 p_in_sample) const;
  Vec3 LightAt(int light, Vec3 p_in_sample) const;
};

inline constexpr int kMaxSize = 16384, kMaxDirections = 16384;

// InvalidArgument unless sizes are positive and bounded (W, H <= 16384; W*H*nV*nL*3 <= 2^40),
// directions are finite unit vectors (1e-3) and unique (1e-6 rad), at least one view and one light,
// positions and mask match in length or are empty, positions, pitch and h_ref are finite.
Status CheckHeader(const BtfHeader& header);

// Dense float storage [view][light][texel][rgb], light fastest among directions, and a presence
// flag per (view, light): absent is not black. Movable, copyable; const access is reentrant.
class SampledBtf {
 public:
  SampledBtf() = default;
  // All absent, values zero. The header must satisfy CheckHeader.
  explicit SampledBtf(BtfHeader header);

  const BtfHeader& header() const { return header_; }
  BtfHeader& mutable_header() { return header_; }  // sizes and direction counts must not change
  bool Present(int view, int light) const { return present_[PairIndex(view, light)] != 0; }
  void SetPresent(int view, int light, bool present) {
    present_[PairIndex(view, light)] = present ? 1 : 0;
  }
  size_t present_count() const;
  // W*H*3 values, row by row from the top, RGB interleaved.
  std::span<const float> Image(int view, int light) const {
    return {values_.data() + PairIndex(view, light) * image_size(), image_size()};
  }
  std::span<float> MutableImage(int view, int light) {
    return {values_.data() + PairIndex(view, light) * image_size(), image_size()};
  }
  // How far the values can be trusted, where that is known: the variance of a texel's R, G and B (its
  // mean over the three), sr^-2, W*H values a pair. There are none before AddVariance, which makes all 0.
  bool has_variance() const { return !variance_.empty(); }
  void AddVariance() { variance_.assign(present_.size() * header_.texel_count(), 0.0f); }
  std::span<const float> Variance(int view, int light) const {
    return {variance_.data() + PairIndex(view, light) * header_.texel_count(),
            header_.texel_count()};
  }
  std::span<float> MutableVariance(int view, int light) {
    return {variance_.data() + PairIndex(view, light) * header_.texel_count(),
            header_.texel_count()};
  }
  size_t image_size() const { return header_.texel_count() * 3; }
  size_t PairIndex(int view, int light) const {
    return static_cast<size_t>(view) * header_.lights.size() + static_cast<size_t>(light);
  }

 private:
  BtfHeader header_;
  std::vector<uint8_t> present_;
  std::vector<float> values_, variance_;
};

}  // namespace mesorig::btf
