#pragma once
// The exact values of a BTF (DESIGN, "What truth is"): the average over each texel's footprint on
// the reference plane, at the directions that the texel really had, per irradiance of a plane
// perpendicular to l at the texel's centre:
//
//   value = < f_r cos(theta_l) V d_ref^2 / d_hit^2 >,
//
// over p in the footprint; the ray from p along -v meets the sample at `hit`, V is 1 where the lamp
// is seen from there; d are distances of the lamp from the hit and from the texel's centre. For
// lamps at infinity the ratio is 1.

#include <functional>
#include <optional>
#include <vector>

#include "processing/btf/sampled_btf.h"
#include "simulator/world/world.h"

namespace mesorig::world {

struct TruthOptions {
  int strata = 4;        // a side: strata^2 rays a texel and view
  bool nominal = false;  // ignore where cameras and lamps stood: the header's directions everywhere
  int threads = 2;
  std::function<void(double fraction)> progress;  // optional; called between views
};

struct Truth {
  btf::SampledBtf btf;  // without positions when `nominal`
  // Root mean square, over all values, of the standard error that the variance among a texel's
  // strata gives. Strata are stratified: an upper bound. Nothing for one stratum.
  std::optional<double> standard_error;
  double seconds = 0;
};

// `present`: v * nL + l, as in BtfFileInfo; absent pairs stay absent and cost nothing. InvalidArgument
// when the header is not valid, has no pitch, is uncalibrated, lacks the cosine, has a view at or
// below the horizon, or when the relief is not below its reference plane.
StatusOr<Truth> ComputeTruth(const World& world, const btf::BtfHeader& header,
                             const std::vector<uint8_t>& present, const TruthOptions& options);

}  // namespace mesorig::world
