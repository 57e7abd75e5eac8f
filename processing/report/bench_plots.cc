#include "processing/report/bench_plots.h"

#include <algorithm>
#include <cstdlib>
#include <map>

#include "processing/report/gnuplot.h"

namespace mesorig::report {
namespace {

// Block 0 of the data is the front, each other one a series; a block's first line has its name, and
// the fifth column of all is 2 * colour + dash: a codec's series share a colour.
#define MESORIG_BENCH_PLOT(xlabel, ylabel, more)                                                  \
  "set encoding utf8\n"                                                                           \
  "set terminal pngcairo size 1500,900 font 'sans,20' background rgb 'white' lw 2\n"              \
  "set output 'plot.png'\nset border 3 lc rgb '#808080'\n"                                        \
  "set tics nomirror tc rgb '#404040'\nset grid lc rgb '#e4e4e4' lt 1\n"                          \
  "set key outside right top tc rgb '#404040' noenhanced samplen 2\n"                             \
  "stats 'data.txt' using 2:3 nooutput\nn = int(STATS_blocks)\narray k[n]\n"                      \
  "do for [i=1:n-1] {stats 'data.txt' index i using 5 nooutput\nk[i] = int(STATS_min)}\n"         \
  "array c[12] = [0x2f6db5,0xd9822b,0x3f9a52,0xb5433a,0x7a5bb0,0x8a6d3b,0x3f9d9d,0xc65f9b,"       \
  "0x505050,0x8fae1b,0x1f3f7f,0xe0b020]\n"                                                        \
  "set logscale xy 10\nset format y '%g'\nset xlabel '" xlabel "'\n"                              \
  "set ylabel '" ylabel "'\nset ytics ("                                                          \
  "1,0.8,0.6,0.5,0.4,0.3,0.2,0.15,0.1,0.08,0.06,0.05,0.04,0.03,0.02,0.015,"                       \
  "0.01,0.008,0.006,0.005,0.004,0.003,0.002,0.0015,0.001,0.0008,0.0006,0.0005,"                   \
  "0.0004,0.0003,0.0002,0.00015,0.0001,8e-05,6e-05,5e-05,4e-05,3e-05,2e-05,"                      \
  "1.5e-05,1e-05,8e-06,6e-06,5e-06,4e-06,3e-06,2e-06,1.5e-06,1e-06"                               \
  ")\n" more "set autoscale xfix\nset autoscale yfix\nset offsets graph 0.04,graph 0.04,graph 0.05,graph 0.05\n" \
  "plot 'data.txt' index 0 using 2:3 with lines lc rgb '#d8d8d8' lw 6 "                           \
  "title columnheader(1), for [i=1:n-1] '' index i using 2:3 with linespoints "                   \
  "pt 1+k[i]%15 dt 1+k[i]%2 ps 1.3 lc rgb c[1+k[i]/2%12] title columnheader(1), "                 \
  "for [i=1:n-1] '' index i using 2:3:4 with labels font 'sans,13' offset 0.8,0.6 "               \
  "tc rgb '#707070' noenhanced notitle\n"

constexpr std::string_view kBytes = MESORIG_BENCH_PLOT("size, MB", "relative error", "");
constexpr std::string_view kEncode = MESORIG_BENCH_PLOT("encoding, s", "relative error", "");
constexpr std::string_view kAccess = MESORIG_BENCH_PLOT("random access, µs a sample", "relative error", "");
constexpr std::string_view kImages = MESORIG_BENCH_PLOT("whole images, µs a sample", "relative error", "");
constexpr std::string_view kTerms = MESORIG_BENCH_PLOT(
    "terms", "RMS error", "set xtics (1,2,4,8,16,32,64,128,256,512,1024,2048,4096)\n");

double CostOf(const BenchRow& row, const BenchPlot& plot) {
  if (plot.x == nullptr) return std::atof(row.label.c_str());
  const double x = row.*(plot.x);
  if (!(x > 0)) return 0;
  return plot.factor * (plot.inverse ? 1 / x : x);
}

std::string Line(std::string_view name, double x, double y, std::string_view label, size_t look) {
  return fmt::format("{} {} {} {} {}\n", DataText(name), x, y, DataText(label), look);
}

}  // namespace

const std::vector<BenchPlot>& BenchPlots() {
  static const std::vector<BenchPlot> plots = {
      {"plot_bytes.png", "Error against size; terms beside the points.", kBytes, &BenchRow::bytes,
       1e-6, false, true},
      {"plot_encode.png", "Error against encoding time.", kEncode, &BenchRow::encode_s, 1, false,
       true},
      {"plot_access.png", "Error against the time of one sample at random, fully interpolated.",
       kAccess, &BenchRow::access_samples_per_s, 1e6, true, true},
      {"plot_images.png", "Error against the time of one sample in whole images.", kImages,
       &BenchRow::image_samples_per_s, 1e6, true, true},
      {"plot_terms.png", "RMS error against the number of terms (Müller et al. 2004, Fig. 12).",
       kTerms, nullptr, 1, false, false, &BenchRow::rmse},
  };
  return plots;
}

const BenchPlot& MaterialsPlot() {
  static const BenchPlot plot = {"plot_materials.png",
                                 "RMS error of fmf against the number of terms, a line a material.",
                                 kTerms, nullptr, 1, false, false, &BenchRow::rmse};
  return plot;
}

Status PlotBench(const BenchReport& report, const BenchPlot& plot,
                 const std::filesystem::path& png) {
  std::vector<std::string> names;  // in order of the rows
  std::map<std::string, std::string> blocks;
  std::vector<std::string> codecs;
  std::vector<BenchRow> costed;  // with the cost in bytes: the front's rows
  for (const BenchRow& row : report.rows) {
    const double x = CostOf(row, plot);
    const double y = row.*(plot.y);
    if (!(x > 0) || !(y > 0)) continue;
    const auto codec = std::find(codecs.begin(), codecs.end(), row.codec);
    const size_t look = 2 * static_cast<size_t>(codec - codecs.begin()) + (row.series != row.codec ? 1 : 0);
    if (codec == codecs.end()) codecs.push_back(row.codec);
    if (!blocks.contains(row.series)) {
      names.push_back(row.series);
      blocks[row.series] = Line(row.series, x, y, "", look);
    }
    blocks[row.series] += Line(row.series, x, y, row.label, look);
    costed.emplace_back();
    costed.back().bytes = x;
    costed.back().rel_error = y;
  }
  if (costed.size() < 2) return NotFound("fewer than two rows have this figure");
  std::string data = Line(plot.front ? "Pareto front" : "", 1, 1, "", 0);
  const std::vector<size_t> front = ParetoFront(costed, &BenchRow::bytes);
  for (const size_t i : front) data += Line("", costed[i].bytes, costed[i].rel_error, "", 0);
  if (!plot.front) data = Line("", 1, 1, "", 0) + Line("", costed[0].bytes, costed[0].rel_error, "", 0);
  for (const std::string& name : names) data += "\n\n" + blocks[name];
  return Plot(plot.script, data, png);
}

}  // namespace mesorig::report
