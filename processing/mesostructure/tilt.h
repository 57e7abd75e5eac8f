#pragma once
// Where the laser's sheet stood in a frame: its tilt (docs/laser.md), told by the stripe on the
// turntable. Reentrant.

#include <optional>
#include <span>
#include <vector>

#include "processing/mesostructure/sweep_geometry.h"

namespace mesorig::mesostructure {

struct TiltFix {
  double tilt_rad = 0;
  double variance = 0;  // rad^2
};

// `image`: the region of one frame; its `usable` is the reference region. The line of the stripe is
// fitted in the image; the pencil's plane through its best known point is the sheet.
// FailedPrecondition, saying why: no stripe, two stripes, or a line on the turntable that is not
// parallel to the pencil's axis (kParallel beyond what the line's own error explains).
inline constexpr double kParallel = 0.02;  // rad
StatusOr<TiltFix> FindTilt(const SweepGeometry& geometry, const StripeImage& image);

// The tilts of a whole sweep. A fix that stands off the line of its neighbours by more than a third
// of a step, at the ends two thirds (and five standard deviations), is dropped; gaps of at most
// kLongestGap frames between two fixes are bridged, the motor turning steadily; longer ones, and
// what lies before the first or behind the last fix, stay without. A sweep that turns back, or loses more
// than a third of its fixes so, is not one: then all are dropped.
inline constexpr size_t kLongestGap = 3;
std::vector<std::optional<TiltFix>> CompleteTilts(std::span<const std::optional<TiltFix>> fixes);

}  // namespace mesorig::mesostructure
