#pragma once
// The report of `mesorig-btf bench`: error against size, encode time and decode time of all codecs on
// one BTF, what is on the Pareto front, and a recommendation.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "processing/report/errors_by_angle.h"
#include "protocol/base/status.h"

namespace mesorig::report {

// One codec at one setting.
struct BenchRow {
  std::string codec, series, label, options_json;
  double rel_error = 0, rmse = 0, psnr_db = 0, p99_abs = 0, max_abs = 0, clamped_mass = 0;
  double bytes = 0, ratio = 0;
  double encode_s = 0, image_samples_per_s = 0, access_samples_per_s = 0;
  double peak_bytes = -1;  // below 0: unknown
  ErrorsByAngleResult by_angle;
  std::optional<std::string> picture;  // relative to the page
};
struct BenchReport {
  std::string input, what;  // the file, and its size in words
  double raw_bytes = 0;     // as half without packing: ratio's numerator
  double file_bytes = 0;    // of the input
  double peak = 1;          // of PSNR
  bool calibrated = true;
  std::vector<BenchRow> rows;
  std::vector<double> error_limits = {0.5, 0.3, 0.2, 0.1, 0.05, 0.03, 0.02};
  // Other materials at each number of terms of fmf, `series` being the material: codec, label and rmse
  // alone are looked at (Müller et al. 2004, Fig. 12). May be empty.
  std::vector<BenchRow> materials;
};

// Rows that no other row beats in both error and `cost`, by falling error.
std::vector<size_t> ParetoFront(const std::vector<BenchRow>& rows, double BenchRow::*cost);

// The error that fmf has at so many bytes: between its rows (the front of all that it stores)
// interpolated in the logarithm of both; beyond its largest file that one's, which more bytes would
// lower. Nothing below its smallest file, and without fmf among the rows.
struct FmfError {
  double rel_error = 0;
  bool beyond = false;  // at most so much
  // Whether `error` loses at these bytes; nothing where that cannot be said.
  std::optional<bool> Beats(double error) const {
    if (error > rel_error) return true;
    return beyond ? std::nullopt : std::optional<bool>(false);
  }
};
std::optional<FmfError> FmfErrorAt(const std::vector<BenchRow>& rows, double bytes);

// Of the rows with rel_error at most `limit`: the smallest, and the fastest at random access. Nothing
// where no row stays within it.
struct Recommendation {
  double limit = 0;
  std::optional<size_t> smallest, fastest;
};
std::vector<Recommendation> Recommend(const BenchReport& report);

// All of it as one JSON object.
std::string BenchJson(const BenchReport& report);

// bench.json, bench.html and plots into `folder`, which must be there. Returns what is left out and
// why (no gnuplot).
StatusOr<std::vector<std::string>> WriteBench(const BenchReport& report,
                                              const std::filesystem::path& folder);

}  // namespace mesorig::report
