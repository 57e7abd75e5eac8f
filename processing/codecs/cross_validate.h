#pragma once
// Leave one light out, encode the rest, predict it: how well a codec knows light directions that
// were not measured. Beside it a Lambert fit (per texel, unweighted least squares of the grey value
// on the light vector), in the same run.

#include <functional>
#include <vector>

#include "processing/btf/sampled_btf.h"
#include "processing/codecs/encoder.h"

namespace mesorig::codecs {

struct LightScore {
  int light = 0;
  double psnr_db = 0, lambert_psnr_db = 0;
};
struct CrossValidation {
  std::vector<LightScore> lights;
  double psnr_db = 0, lambert_psnr_db = 0;  // of the mean square over all lights
  double seconds = 0;                       // encoding and prediction by the codec
};

// What was measured and what was predicted for one held-out light: W*H*3 values each.
using OnPrediction = std::function<Status(int view, int light, std::span<const float> measured,
                                          std::span<const float> predicted)>;
// Called after each light with the fraction that is done.
using OnProgress = std::function<void(double fraction)>;

// PSNR of Rec. 601 grey inside the mask: an uncalibrated BTF as code values, times 255, clipped to
// 0-255 without rounding, peak 255; a calibrated one clipped below 0, peak 1/pi.
// `btf` has its presence changed during the call and restored before it returns. UNIMPLEMENTED from
// codecs that predict nothing; InvalidArgument for fewer than four lights.
StatusOr<CrossValidation> CrossValidate(btf::SampledBtf& btf, const Encoder& encoder,
                                        const EncodeOptions& options,
                                        const OnPrediction& on_prediction = {},
                                        const OnProgress& on_progress = {});

}  // namespace mesorig::codecs
