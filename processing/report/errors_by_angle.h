#pragma once
// Where the error lies: figures per ring of views and per ring of lights. Reentrant.

#include <vector>

#include "processing/btf/errors.h"
#include "processing/btf/sampled_btf.h"
#include "protocol/base/status.h"

namespace mesorig::report {

struct AngleErrors {
  double theta_deg = 0;  // mean polar angle of the ring's directions
  double psnr_db = 0, rel_error = 0, rmse = 0;  // as btf::BtfErrors
  size_t pairs = 0;
};
struct ErrorsByAngleResult {
  std::vector<AngleErrors> by_view_theta, by_light_theta;  // ascending
};

// Directions whose polar angles differ by less than 1 degree from the ring's first one are one ring.
// Errors as btf::CompareBtf; a ring whose reference is zero everywhere has rel_error 0 if it is met
// exactly, and 1 otherwise.
StatusOr<ErrorsByAngleResult> ErrorsByAngle(const btf::SampledBtf& a,
                                            const btf::SampledBtf& reference);

}  // namespace mesorig::report
