#pragma once
// Error figures of one BTF against another, over the samples present in both. Sums in double.

#include <string>

#include "processing/btf/sampled_btf.h"

namespace mesorig::btf {

inline constexpr double kPsnrPeak = 1 / kPi;  // sr^-1: a white diffuser that faces the light

struct BtfErrors {
  double rel_error = 0;   // ||a - b|| / ||b||; b is the reference
  double rmse = 0;        // sr^-1
  double psnr_db = 0;     // 20 log10(peak / rmse); kMaxPsnrDb for equal data
  double max_abs = 0;     // sr^-1
  double peak = kPsnrPeak;  // what psnr_db is relative to
  size_t samples = 0;     // values compared
  size_t pairs = 0;       // (view, light) pairs compared
};
inline constexpr double kMaxPsnrDb = 200;
double PsnrPeak(const BtfHeader& header);  // 1/pi, or 1 where header.calibrated is false
double PsnrDb(double peak, double rmse);   // at most kMaxPsnrDb

// InvalidArgument when sizes or direction sets differ (1e-4 rad), nothing is present in both, the
// reference is all zero, or a value is not finite. Texels outside the reference's mask do not count.
// The peak is 1/pi sr^-1, and 1 (code value 255) for an uncalibrated reference.
StatusOr<BtfErrors> CompareBtf(const SampledBtf& a, const SampledBtf& reference);

}  // namespace mesorig::btf
