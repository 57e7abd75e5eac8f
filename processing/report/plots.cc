#include "processing/report/plots.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "processing/report/figures.h"
#include "processing/report/gnuplot.h"

namespace mesorig::report {
namespace {

using nlohmann::json;

#define MESORIG_PLOT_STYLE                                                          \
  "set encoding utf8\n"                                                             \
  "set border 3 lc rgb '#808080'\nset tics nomirror tc rgb '#404040'\n"             \
  "set grid lc rgb '#e4e4e4' lt 1\nset key tc rgb '#404040' noenhanced\n"           \
  "set label noenhanced\nblue = 0x2f6db5\norange = 0xd9822b\n"

constexpr std::string_view kByAngle =
    "set terminal pngcairo size 1400,760 font 'sans,22' background rgb 'white' lw 2\n"
    "set output 'plot.png'\n" MESORIG_PLOT_STYLE
    "set xlabel 'polar angle, degrees'\nset ylabel 'PSNR, dB (peak 1/π sr⁻¹)'\n"
    "set xrange [0:90]\nset offsets 0,0,1,1\nset key top right\n"
    "plot for [i=0:1] 'data.txt' index i using 1:2 with linespoints pt 7 ps 1.4 "
    "lc rgb (i == 0 ? blue : orange) title columnheader(1)\n";

constexpr std::string_view kSweep =
    "set terminal pngcairo size 1600,700 font 'sans,20' background rgb 'white' lw 2\n"
    "set output 'plot.png'\n" MESORIG_PLOT_STYLE
    "set multiplot layout 1,2\n"
    "set xlabel 'terms'\nset ylabel 'PSNR, dB' tc rgb blue\nset y2label 'encoding, s' tc rgb orange\n"
    "set y2tics\nset border 11\nset logscale x 2\nset y2range [0:*]\nset offsets graph 0.03,graph 0.03,1,1\n"
    "set key bottom right\n"
    "plot 'data.txt' using 1:3 with linespoints pt 7 ps 1.4 lc rgb blue title 'PSNR', "
    "'' using 1:4 axes x1y2 with linespoints pt 5 ps 1.2 lc rgb orange title 'encoding time'\n"
    "unset y2tics\nunset y2label\nset border 3\nunset key\n"
    "set xlabel 'size, MB'\nset ylabel 'PSNR, dB' tc rgb '#404040'\nset logscale x 10\n"
    "set autoscale xfix\nset offsets graph 0.05,graph 0.12,1,1\n"
    "plot 'data.txt' using 2:3 with linespoints pt 7 ps 1.4 lc rgb blue, "
    "'' using 2:3:5 with labels left offset 0.6,-0.7 tc rgb '#404040' noenhanced\n";

constexpr std::string_view kStages =
    "set terminal pngcairo size 1400,700 font 'sans,22' background rgb 'white' lw 2\n"
    "set output 'plot.png'\n" MESORIG_PLOT_STYLE
    "unset key\nset xlabel 'wall time, s'\nset xrange [0:*]\nset yrange [*:*] reverse\n"
    "set offsets 0,0,0.6,0.6\nset ytics noenhanced\nset grid noy\n"
    "plot 'data.txt' using ($2/2):0:($2/2):(0.35):ytic(1) with boxxyerrorbars fs solid 0.8 noborder "
    "lc rgb blue\n";

// `index` blocks: a header line with the series' name, then angle and PSNR.
std::string AngleBlock(std::string_view name, const std::vector<std::pair<double, double>>& points) {
  std::string block = DataText(name) + "\n";
  for (const auto& [theta, psnr] : points) block += fmt::format("{} {}\n", theta, psnr);
  return block;
}

std::vector<std::pair<double, double>> Pairs(const json* list, const char* x, const char* y) {
  std::vector<std::pair<double, double>> points;
  if (list == nullptr || !list->is_array()) return points;
  for (const json& entry : *list) {
    const auto a = NumberIn(entry, x), b = NumberIn(entry, y);
    if (a && b) points.emplace_back(*a, *b);
  }
  return points;
}

}  // namespace

Status PlotErrorByAngle(const json& report, const std::filesystem::path& png) {
  const auto views = Pairs(Find(report, {"btf", "by_view_theta"}), "theta_deg", "psnr_db");
  const auto lights = Pairs(Find(report, {"btf", "by_light_theta"}), "theta_deg", "psnr_db");
  if (views.empty() || lights.empty()) {
    return NotFound("btf.by_view_theta or btf.by_light_theta holds no theta_deg and psnr_db");
  }
  return Plot(kByAngle,
              AngleBlock("view", views) + "\n\n" + AngleBlock("light", lights), png);
}

Status PlotSweep(const json& report, const std::filesystem::path& png) {
  const json* sweep = Find(report, {"codec", "sweep"});
  std::string data;
  std::set<double> terms;
  for (const json& entry : sweep != nullptr && sweep->is_array() ? *sweep : json::array()) {
    const auto t = NumberIn(entry, "terms"), bytes = NumberIn(entry, "bytes"),
               psnr = NumberIn(entry, "psnr_db"), seconds = NumberIn(entry, "encode_s");
    if (!t || !bytes || !psnr || !seconds || *t <= 0 || *bytes <= 0) continue;
    terms.insert(*t);
    data += fmt::format("{} {} {} {} {}\n", *t, *bytes * 1e-6, *psnr, *seconds,
                        DataText(fmt::format("{:.0f}", *t)));
  }
  if (terms.size() < 2) {
    return NotFound("codec.sweep holds fewer than two numbers of terms with bytes, psnr_db and encode_s");
  }
  return Plot(kSweep, data, png);
}

Status PlotStages(const json& report, const std::filesystem::path& png) {
  const json* stages = Find(report, {"stages"});
  std::string data;
  for (const json& entry : stages != nullptr && stages->is_array() ? *stages : json::array()) {
    const auto seconds = NumberIn(entry, "wall_s");
    const std::string name = TextIn(entry, "name");
    if (seconds && *seconds >= 0 && !name.empty()) {
      data += fmt::format("{} {}\n", DataText(name), *seconds);
    }
  }
  if (data.empty()) return NotFound("stages holds no name and wall_s");
  return Plot(kStages, data, png);
}

}  // namespace mesorig::report
