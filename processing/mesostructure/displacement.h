#pragma once
// The displacement image of one camera and one sweep (Wang et al. 2005, Sec. 3.2): where its pixels
// saw the sheet pass, as distances from the reference plane along the nominal view direction.

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "processing/btf/mdf.h"
#include "processing/mesostructure/sweep_geometry.h"
#include "processing/mesostructure/tilt.h"

namespace mesorig::mesostructure {

// Code values of the sample pixels (SweepGeometry::sample) over a sweep's frames, pixel by pixel,
// so that the frames themselves need not be kept.
class FrameStack {
 public:
  FrameStack(size_t pixels, size_t frames) : frames_(frames), codes_(pixels * frames, kNothing) {}
  void Set(size_t pixel, size_t frame, uint16_t code) { codes_[pixel * frames_ + frame] = code; }
  static constexpr uint16_t kNothing = 0xffff;
  // The codes of one pixel, frame by frame; kNothing where none has come.
  std::span<const uint16_t> Series(size_t pixel) const {
    return {codes_.data() + pixel * frames_, frames_};
  }
  size_t frames() const { return frames_; }

 private:
  size_t frames_;
  std::vector<uint16_t> codes_;
};

// What codes mean.
struct CodeScale {
  double black = 0, electrons_per_code = 1;
  uint16_t saturated = FrameStack::kNothing;  // from here on: a lower bound
  double read_noise_e = 0;
};

struct DisplacementFigures {
  uint32_t frames_with_tilt = 0, frames_bridged = 0;
  uint32_t pixels = 0, peaks = 0;  // of the sample; that gave a point
  uint32_t texels = 0;             // with a distance
};

// A view's texels: D in mm, and a weight in [0, 1], 0 where nothing was seen. The weight is the
// tetrahedron's (SweepGeometry::TetrahedronWeight) times the quality of the peak and the certainty
// of the distance, 1 / (1 + (its standard deviation / 0.2 mm)^2); rays that meet the sheet at less
// than three degrees give nothing, and fade in up to ten. `fixes`: what FindTilt said of each frame
// of the stack. `mdf` has one view: the nominal direction.
struct Displacement {
  btf::Mdf mdf;
  DisplacementFigures figures;
};
btf::MdfHeader DisplacementHeader(const SweepGeometry& geometry, const Product& product);
// FailedPrecondition when fewer than three frames have a tilt.
StatusOr<Displacement> ComputeDisplacement(const SweepGeometry& geometry, const Product& product,
                                           const CodeScale& scale, double sheet_fwhm_mm,
                                           const FrameStack& stack,
                                           std::span<const std::optional<TiltFix>> fixes);

}  // namespace mesorig::mesostructure
