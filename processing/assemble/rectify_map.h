#pragma once
// Where each texel of the product lies in a camera's image, computed once for a camera pose and
// used for every lamp.

#include <cstdint>
#include <span>
#include <vector>

#include "processing/btf/sampled_btf.h"
#include "processing/image/demosaic.h"
#include "protocol/base/status.h"
#include "protocol/rig/rig.h"

namespace mesorig::assemble {

// The mean of the image over each texel's footprint: sub-samples of the texel on the reference
// plane (two a pixel, at least 3 x 3 a texel) are projected through the pinhole and looked up with
// Catmull-Rom interpolation; what comes out is one list of weights a texel, which sum to one. So a
// footprint of many pixels is averaged, a smaller one interpolated, and a foreshortened one is
// averaged across and interpolated along. The image must hold values at pixel centres
// (image::PixelModel::kCentre). Immutable after Build; reentrant.
class RectifyMap {
 public:
  // `grid`: sizes, pitch and h_ref of the product; its directions are not read.
  // FailedPrecondition, naming camera and texel, when the camera stands on or below the reference
  // plane, or when the support of a texel does not lie wholly within the image.
  static StatusOr<RectifyMap> Build(const Camera& camera, const RigidTransform& sample_from_camera,
                                    const btf::BtfHeader& grid);

  // texel_rgb: 3 values a texel, in the image's unit. Returns the number of texels that depend on
  // a saturated pixel: these hold a lower bound. `saturated`: which, one a texel, 0 or 1; may be
  // empty.
  size_t Apply(const image::RgbImage& image, std::span<float> texel_rgb,
               std::span<uint8_t> saturated = {}) const;

  size_t texel_count() const { return first_.size() - 1; }
  size_t weight_count() const { return weight_.size(); }

 private:
  int width_ = 0, height_ = 0;   // of the image
  std::vector<uint32_t> first_;  // of each texel in the lists below, and their end
  std::vector<uint32_t> pixel_;
  std::vector<float> weight_;
};

}  // namespace mesorig::assemble
