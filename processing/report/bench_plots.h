#pragma once
// Internal to processing/report: the plots of a bench report.

#include <filesystem>
#include <string_view>
#include <vector>

#include "processing/report/bench_report.h"

namespace mesorig::report {

// Error of every series against one cost, the Pareto front behind them.
struct BenchPlot {
  const char* file;
  const char* caption;
  std::string_view script;
  double BenchRow::*x;  // null: the label as a number
  double factor;        // to the axis's unit
  bool inverse;         // 1 / x: seconds of samples a second
  bool front;
  double BenchRow::*y = &BenchRow::rel_error;
};
// RMS error against terms, a line a material; report.rows are BenchReport::materials.
const BenchPlot& MaterialsPlot();
const std::vector<BenchPlot>& BenchPlots();
// NotFound when fewer than two rows have the figure.
Status PlotBench(const BenchReport& report, const BenchPlot& plot, const std::filesystem::path& png);

}  // namespace mesorig::report
