#include "processing/report/bench_report.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>

#include "processing/report/bench_plots.h"
#include "processing/report/html.h"
#include "protocol/base/file_writer.h"

namespace mesorig::report {
namespace {

using nlohmann::json;
using Rows = std::vector<std::vector<std::string>>;

json Rings(const std::vector<AngleErrors>& rings) {
  json list = json::array();
  for (const AngleErrors& e : rings) {
    list.push_back({{"theta_deg", e.theta_deg},
                    {"rel_error", e.rel_error},
                    {"psnr_db", e.psnr_db},
                    {"pairs", e.pairs}});
  }
  return list;
}

json RowJson(const BenchRow& r) {
  json row{{"codec", r.codec},
           {"series", r.series},
           {"codec_options", json::parse(r.options_json, nullptr, false)},
           {"rel_error", r.rel_error},
           {"psnr_db", r.psnr_db},
           {"p99_abs", r.p99_abs},
           {"max_abs", r.max_abs},
           {"clamped_mass", r.clamped_mass},
           {"bytes", r.bytes},
           {"ratio", r.ratio},
           {"encode_s", r.encode_s},
           {"image_samples_per_s", r.image_samples_per_s},
           {"access_samples_per_s", r.access_samples_per_s},
           {"by_view_theta", Rings(r.by_angle.by_view_theta)},
           {"by_light_theta", Rings(r.by_angle.by_light_theta)}};
  if (r.peak_bytes >= 0) row["peak_bytes"] = r.peak_bytes;
  if (r.picture) row["picture"] = *r.picture;
  return row;
}

std::string NameOf(const BenchRow& r) {
  return r.label.empty() ? r.series : fmt::format("{}, {} terms", r.series, r.label);
}

std::string Megabytes(double bytes) {
  return bytes < 0 ? "–" : fmt::format("{:.3g}", bytes * 1e-6);
}

std::string MainTable(const BenchReport& report) {
  Rows rows = {{"codec", "relative error", "PSNR, dB", "99th percentile", "clamped mass",
                "size, MB", "ratio", "encoding, s", "whole images, M samples/s",
                "random access, M samples/s", "peak memory, MB"}};
  for (const BenchRow& r : report.rows) {
    rows.push_back({NameOf(r), fmt::format("{:.4f}", r.rel_error), fmt::format("{:.2f}", r.psnr_db),
                    fmt::format("{:.2g}", r.p99_abs), fmt::format("{:.1e}", r.clamped_mass),
                    Megabytes(r.bytes), fmt::format("{:.1f}", r.ratio),
                    fmt::format("{:.2f}", r.encode_s),
                    fmt::format("{:.3g}", r.image_samples_per_s * 1e-6),
                    fmt::format("{:.3g}", r.access_samples_per_s * 1e-6),
                    Megabytes(r.peak_bytes)});
  }
  return Table(rows);
}

// Relative error by ring, of every row that is smallest under some limit.
std::string AngleTable(const BenchReport& report, const char* of,
                       std::vector<AngleErrors> ErrorsByAngleResult::*rings) {
  Rows rows = {{fmt::format("{} at, degrees", of)}};
  std::vector<size_t> chosen;
  for (const Recommendation& r : Recommend(report)) {
    if (!r.smallest || std::count(chosen.begin(), chosen.end(), *r.smallest) > 0) continue;
    chosen.push_back(*r.smallest);
    rows[0].push_back(NameOf(report.rows[*r.smallest]));
  }
  if (chosen.empty()) return "";
  const auto& first = report.rows[chosen[0]].by_angle.*rings;
  for (size_t k = 0; k < first.size(); ++k) {
    std::vector<std::string> row = {fmt::format("{:.1f}", first[k].theta_deg)};
    for (const size_t i : chosen) {
      const auto& list = report.rows[i].by_angle.*rings;
      row.push_back(k < list.size() ? fmt::format("{:.4f}", list[k].rel_error) : "–");
    }
    rows.push_back(std::move(row));
  }
  return Table(rows);
}

std::string RecommendationTable(const BenchReport& report) {
  Rows rows = {{"relative error at most", "smallest", "size, MB", "fastest at random access",
                "M samples/s"}};
  for (const Recommendation& r : Recommend(report)) {
    std::vector<std::string> row = {fmt::format("{:g}", r.limit), "none of these", "–",
                                    "none of these", "–"};
    if (r.smallest) {
      row[1] = NameOf(report.rows[*r.smallest]);
      row[2] = Megabytes(report.rows[*r.smallest].bytes);
    }
    if (r.fastest) {
      row[3] = NameOf(report.rows[*r.fastest]);
      row[4] = fmt::format("{:.3g}", report.rows[*r.fastest].access_samples_per_s * 1e-6);
    }
    rows.push_back(std::move(row));
  }
  return Table(rows);
}

// Numbers that others printed, beside ours, for what they are: other data.
std::string Literature() {
  const Rows rows = {
      {"published", "data", "size, MB"},
      {"raw (Müller et al. 2004, Sec. 3.3)", "81 x 81 x 256 x 256", "1200"},
      {"scaled Lafortune lobes", "the same", "32"},
      {"reflectance fields", "the same", "106"},
      {"chained factorisation", "the same", "60"},
      {"per view, 8 terms", "the same", "121"},
      {"per cluster, 32 clusters of 8 terms", "the same", "11"},
      {"view-svd, 4 terms (Wang et al. 2005, Table 1)", "64 x 64 to 128 x 128, 60 to 96 directions",
       "1.3 to 7.5"}};
  return Table(rows) +
         Paragraph("Printed sizes are of other materials. Those of Wang et al. do not follow from "
                   "four terms of RGB floats: 128 x 128 texels, 96 lights, 4 terms, 3 channels are "
                   "75 MB as float and 38 MB as half before packing.");
}

}  // namespace

std::vector<size_t> ParetoFront(const std::vector<BenchRow>& rows, double BenchRow::*cost) {
  std::vector<size_t> order(rows.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    const double x = rows[a].*cost, y = rows[b].*cost;
    return x != y ? x < y : rows[a].rel_error < rows[b].rel_error;
  });
  std::vector<size_t> front;
  for (const size_t i : order) {
    if (front.empty() || rows[i].rel_error < rows[front.back()].rel_error) front.push_back(i);
  }
  return front;
}

std::vector<Recommendation> Recommend(const BenchReport& report) {
  std::vector<Recommendation> list;
  for (const double limit : report.error_limits) {
    Recommendation r;
    r.limit = limit;
    for (size_t i = 0; i < report.rows.size(); ++i) {
      const BenchRow& row = report.rows[i];
      if (!(row.rel_error <= limit)) continue;
      if (!r.smallest || row.bytes < report.rows[*r.smallest].bytes) r.smallest = i;
      if (!r.fastest ||
          row.access_samples_per_s > report.rows[*r.fastest].access_samples_per_s) {
        r.fastest = i;
      }
    }
    list.push_back(r);
  }
  return list;
}

std::string BenchJson(const BenchReport& report) {
  json rows = json::array(), front = json::array(), recommendation = json::array();
  for (const BenchRow& row : report.rows) rows.push_back(RowJson(row));
  for (const size_t i : ParetoFront(report.rows, &BenchRow::bytes)) front.push_back(i);
  for (const Recommendation& r : Recommend(report)) {
    json entry{{"rel_error_at_most", r.limit}};
    if (r.smallest) entry["smallest"] = NameOf(report.rows[*r.smallest]);
    if (r.fastest) entry["fastest"] = NameOf(report.rows[*r.fastest]);
    recommendation.push_back(std::move(entry));
  }
  return json{{"input", report.input},
              {"uncompressed_bytes", report.raw_bytes},
              {"input_bytes", report.file_bytes},
              {"psnr_peak", report.peak},
              {"calibrated", report.calibrated},
              {"rows", std::move(rows)},
              {"pareto_bytes", std::move(front)},
              {"recommendation", std::move(recommendation)}}
      .dump(2);
}

StatusOr<std::vector<std::string>> WriteBench(const BenchReport& report,
                                              const std::filesystem::path& folder) {
  std::vector<std::string> skipped, figures, pictures;
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(folder / "bench.json", BenchJson(report) + "\n"));
  for (const BenchPlot& plot : BenchPlots()) {
    const Status status = PlotBench(report, plot, folder / plot.file);
    if (status.ok()) {
      figures.push_back(report::Figure(plot.file, plot.caption));
    } else {
      skipped.push_back(fmt::format("{}: {}", plot.file, Message(status)));
    }
  }
  for (const BenchRow& row : report.rows) {
    if (row.picture) pictures.push_back(report::Figure(*row.picture, NameOf(row)));
  }
  std::string body = Section("Error against size and time", MainTable(report) + Figures(figures));
  body += Section("Relative error by elevation",
                  AngleTable(report, "view", &ErrorsByAngleResult::by_view_theta) +
                      AngleTable(report, "light", &ErrorsByAngleResult::by_light_theta));
  if (!pictures.empty()) {
    body += Section("Apparent BRDFs of one texel, views down and lights across: original, decoded, "
                    "four times the difference", Figures(pictures));
  }
  body += Section("Published sizes", Literature());
  body += Section("Recommendation", RecommendationTable(report));
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(
      folder / "bench.html", Page("Compression of " + report.input, report.what, body)));
  return skipped;
}

}  // namespace mesorig::report
