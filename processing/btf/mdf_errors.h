#pragma once
// Error figures of an MDF against the true one. Sums in double.

#include <vector>

#include "processing/btf/mdf.h"

namespace mesorig::btf {

struct MdfFigures {
  double median_abs_mm = 0, rmse_mm = 0;  // of D over the texels compared
  // Of the texels that have a truth, the share with a measurement (confidence > 0).
  double coverage = 0;
  size_t texels = 0;  // compared: measured, with a truth; all views together
  int views = 0;
};
struct MdfRing : MdfFigures {
  double theta_deg = 0;  // mean polar angle of the ring's views
};
struct MdfErrors : MdfFigures {
  // How well a constant plane would do on the same texels: z = best_plane_z_mm, the same for all
  // views, has D = (h_ref - z) / v.z; its height is the one whose median |error| is least.
  double best_plane_median_abs_mm = 0, best_plane_z_mm = 0;
  std::vector<MdfRing> by_view_theta;  // all views, in rings of one degree, ascending
};

inline constexpr double kMdfThetaLimit = RadFromDeg(60);

// `truth`: confidence 0 marks texels without one. Views more than half a degree beyond
// `theta_limit_rad` do not count (but have rings): a camera at 60 degrees from the turntable's centre
// stands a quarter of a degree flatter over the reference plane.
// InvalidArgument when sizes, pitch, h_ref or views differ (1e-4 rad, 1e-6 of lengths), when no
// view lies within the limit, or when nothing was measured there.
StatusOr<MdfErrors> CompareMdf(const Mdf& mdf, const Mdf& truth,
                               double theta_limit_rad = kMdfThetaLimit);

}  // namespace mesorig::btf
