#pragma once
// A mesostructure distance function (Wang et al. 2005, Sec. 3, Fig. 2), sampled: for every measured
// view direction v and texel p of the reference plane the distance D >= 0 (mm) at which the
// mesostructure is met at p - D v. Frames, texels and directions are those of sampled_btf.h: an MDF
// and a BTF of one session share the reference plane texel for texel.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"

namespace mesorig::btf {

struct MdfHeader {
  int width = 0, height = 0;            // texels
  double pitch_mm = 0;                  // texel spacing on the reference plane, > 0
  double h_ref_mm = 0;                  // height of the reference plane in the sample frame
  std::vector<Vec3> views;              // unit vectors, unique, z > 0: D is along these
  std::vector<Vec3> view_positions_mm;  // where the camera stood, sample frame; may be empty
  bool calibrated = true;
  std::string provenance_json = "{}";

  int view_count() const { return static_cast<int>(views.size()); }
  size_t texel_count() const { return static_cast<size_t>(width) * static_cast<size_t>(height); }
  // Centre of texel (i, j) on the reference plane, mm, sample frame.
  Vec3 TexelCentre(int i, int j) const {
    return {(i + 0.5 - width / 2.0) * pitch_mm, (height / 2.0 - j - 0.5) * pitch_mm, h_ref_mm};
  }
};

// InvalidArgument unless sizes are positive and bounded (as CheckHeader of a BTF), pitch and h_ref
// finite and positive, directions finite unit vectors that look up (z >= 0.01) and unique,
// positions finite and as many as views, or none.
Status CheckMdfHeader(const MdfHeader& header);

// Dense float storage [view][texel]. Movable, copyable; const access is reentrant.
class Mdf {
 public:
  Mdf() = default;
  // D = 0 and confidence 0 everywhere. The header must satisfy CheckMdfHeader.
  explicit Mdf(MdfHeader header);

  const MdfHeader& header() const { return header_; }
  MdfHeader& mutable_header() { return header_; }  // sizes and view count must not change
  // W*H values, row by row from the top. Distance in mm; confidence >= 0, and 0 where the distance
  // was filled in, not measured.
  std::span<const float> Distance(int view) const {
    return {distance_.data() + Offset(view), header_.texel_count()};
  }
  std::span<float> MutableDistance(int view) {
    return {distance_.data() + Offset(view), header_.texel_count()};
  }
  std::span<const float> Confidence(int view) const {
    return {confidence_.data() + Offset(view), header_.texel_count()};
  }
  std::span<float> MutableConfidence(int view) {
    return {confidence_.data() + Offset(view), header_.texel_count()};
  }

 private:
  size_t Offset(int view) const { return static_cast<size_t>(view) * header_.texel_count(); }

  MdfHeader header_;
  std::vector<float> distance_, confidence_;
};

}  // namespace mesorig::btf
