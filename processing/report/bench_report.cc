#include "processing/report/bench_report.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>

#include "processing/report/bench_plots.h"
#include "processing/report/html.h"
#include "processing/report/published.h"
#include "protocol/base/file_writer.h"

namespace mesorig::report {
namespace {

using nlohmann::json;
using Rows = std::vector<std::vector<std::string>>;

constexpr char kReference[] = "fmf";  // what the others are set beside

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

json RowJson(const BenchReport& report, const BenchRow& r) {
  json row{{"codec", r.codec},
           {"series", r.series},
           {"codec_options", json::parse(r.options_json, nullptr, false)},
           {"rel_error", r.rel_error},
           {"rmse", r.rmse},
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
  if (const auto fmf = FmfErrorAt(report.rows, r.bytes); fmf && r.codec != kReference) {
    row[fmf->beyond ? "fmf_rel_error_at_most" : "fmf_rel_error_at_these_bytes"] = fmf->rel_error;
    if (const auto beats = fmf->Beats(r.rel_error)) row["loses_to_fmf"] = *beats;
  }
  return row;
}

std::string NameOf(const BenchRow& r) {
  if (r.label.empty()) return r.series;
  return fmt::format("{}, {} {}", r.series, r.label, r.label == "1" ? "term" : "terms");
}

std::string Megabytes(double bytes) {
  return bytes < 0 ? "–" : fmt::format("{:.3g}", bytes * 1e-6);
}

std::string ErrorTable(const BenchReport& report) {
  Rows rows = {{"codec", "size, MB", "ratio", "relative error", "PSNR, dB", "99th percentile",
                "clamped mass", "fmf at this size", "beside fmf"}};
  for (const BenchRow& r : report.rows) {
    const FmfError fmf = r.codec == kReference
                             ? FmfError()
                             : FmfErrorAt(report.rows, r.bytes).value_or(FmfError());
    const bool there = fmf.rel_error > 0;
    const auto beats = fmf.Beats(r.rel_error);
    rows.push_back({NameOf(r), Megabytes(r.bytes), fmt::format("{:.1f}", r.ratio),
                    fmt::format("{:.4f}", r.rel_error), fmt::format("{:.2f}", r.psnr_db),
                    fmt::format("{:.2g}", r.p99_abs), fmt::format("{:.1e}", r.clamped_mass),
                    there ? fmt::format("{}{:.4f}", fmf.beyond ? "at most " : "", fmf.rel_error) : "–",
                    there && beats ? fmt::format("{:.2f} x{}", r.rel_error / fmf.rel_error,
                                                 *beats ? ", loses" : "")
                                   : "–"});
  }
  return Table(rows);
}

std::string TimeTable(const BenchReport& report) {
  Rows rows = {{"codec", "relative error", "encoding, s", "whole images, M samples/s",
                "random access, M samples/s", "peak memory, MB"}};
  for (const BenchRow& r : report.rows) {
    rows.push_back({NameOf(r), fmt::format("{:.4f}", r.rel_error), fmt::format("{:.2f}", r.encode_s),
                    fmt::format("{:.3g}", r.image_samples_per_s * 1e-6),
                    fmt::format("{:.3g}", r.access_samples_per_s * 1e-6),
                    Megabytes(r.peak_bytes)});
  }
  return Table(rows);
}

// Which codecs lose to fmf at equal bytes at all their settings, which at none.
std::string BesideFmf(const BenchReport& report) {
  std::map<std::string, std::pair<int, int>> lost;  // of how many
  for (const BenchRow& r : report.rows) {
    if (r.codec == kReference) continue;
    const auto fmf = FmfErrorAt(report.rows, r.bytes);
    const auto beats = fmf ? fmf->Beats(r.rel_error) : std::nullopt;
    if (!beats) continue;
    lost[r.codec].first += *beats ? 1 : 0;
    lost[r.codec].second += 1;
  }
  std::string text;
  for (const auto& [codec, counts] : lost) {
    text += fmt::format("{}{} at {} of {} settings", text.empty() ? "" : ", ", codec, counts.first,
                        counts.second);
  }
  if (text.empty()) return "";
  return Paragraph("Beside fmf: the error over that of fmf at equal bytes, interpolated between its "
                   "settings (beyond its largest file it has at most that file's error). Lose to fmf: " + text +
                   ". What loses in bytes may win in time: the second table.");
}

// Relative error by ring, of every row that is smallest under some limit.
std::string AngleTable(const BenchReport& report, const char* of,
                       std::vector<AngleErrors> ErrorsByAngleResult::*rings) {
  Rows rows = {{fmt::format("{} at, degrees", of)}};
  std::vector<size_t> chosen;
  for (const Recommendation& r : Recommend(report)) {
    if (!r.smallest || std::count(chosen.begin(), chosen.end(), *r.smallest) > 0) continue;
    chosen.push_back(*r.smallest);
  }
  if (chosen.empty()) {  // none within any limit: the best there is
    const std::vector<size_t> front = ParetoFront(report.rows, &BenchRow::bytes);
    if (!front.empty()) chosen.push_back(front.back());
  }
  for (const size_t i : chosen) rows[0].push_back(NameOf(report.rows[i]));
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
  Rows rows = {{"relative error at most", "smallest", "size, MB", "its error",
                "fastest at random access", "M samples/s", "its error"}};
  std::string out_of_reach;
  for (const Recommendation& r : Recommend(report)) {
    if (!r.smallest || !r.fastest) {
      out_of_reach += fmt::format("{}{:g}", out_of_reach.empty() ? "" : ", ", r.limit);
      continue;
    }
    const BenchRow &small = report.rows[*r.smallest], &fast = report.rows[*r.fastest];
    rows.push_back({fmt::format("{:g}", r.limit), NameOf(small), Megabytes(small.bytes),
                    fmt::format("{:.4f}", small.rel_error), NameOf(fast),
                    fmt::format("{:.3g}", fast.access_samples_per_s * 1e-6),
                    fmt::format("{:.4f}", fast.rel_error)});
  }
  std::string html = rows.size() > 1 ? Table(rows) : "";
  if (!out_of_reach.empty()) {
    html += Paragraph("No setting tried stays within " + out_of_reach + "; more terms might.");
  }
  return html;
}

}  // namespace

std::optional<FmfError> FmfErrorAt(const std::vector<BenchRow>& rows, double bytes) {
  std::vector<BenchRow> curve;
  for (const BenchRow& row : rows) {
    if (row.codec == kReference && row.bytes > 0 && row.rel_error > 0) curve.push_back(row);
  }
  const std::vector<size_t> front = ParetoFront(curve, &BenchRow::bytes);
  if (front.empty() || !(bytes >= curve[front[0]].bytes)) return std::nullopt;
  for (size_t i = 1; i < front.size(); ++i) {
    const BenchRow &a = curve[front[i - 1]], &b = curve[front[i]];
    if (bytes > b.bytes) continue;
    const double t = std::log(bytes / a.bytes) / std::log(b.bytes / a.bytes);
    return FmfError{a.rel_error * std::pow(b.rel_error / a.rel_error, t), false};
  }
  const BenchRow& last = curve[front.back()];
  return FmfError{last.rel_error, bytes > last.bytes};
}

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

namespace {

// Of a rate: what costs is its inverse.
std::vector<size_t> FastestFront(std::vector<BenchRow> rows, double BenchRow::*rate) {
  for (BenchRow& row : rows) row.*rate = -(row.*rate);
  return ParetoFront(rows, rate);
}

}  // namespace

std::string BenchJson(const BenchReport& report) {
  json rows = json::array(), recommendation = json::array(), materials = json::array();
  for (const BenchRow& row : report.rows) rows.push_back(RowJson(report, row));
  for (const BenchRow& row : report.materials) {
    materials.push_back({{"material", row.series}, {"terms", row.label}, {"rmse", row.rmse}});
  }
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
              {"pareto_bytes", ParetoFront(report.rows, &BenchRow::bytes)},
              {"pareto_encode", ParetoFront(report.rows, &BenchRow::encode_s)},
              {"pareto_access", FastestFront(report.rows, &BenchRow::access_samples_per_s)},
              {"pareto_images", FastestFront(report.rows, &BenchRow::image_samples_per_s)},
              {"rmse_by_material", std::move(materials)},
              {"published", PublishedJson()},
              {"recommendation", std::move(recommendation)}}
      .dump(2);
}

namespace {

// Of each codec the row with a picture that has the least error.
std::vector<size_t> Pictured(const std::vector<BenchRow>& rows) {
  std::vector<size_t> chosen;
  for (size_t i = 0; i < rows.size(); ++i) {
    if (!rows[i].picture) continue;
    const auto same = std::find_if(chosen.begin(), chosen.end(),
                                   [&](size_t k) { return rows[k].codec == rows[i].codec; });
    if (same == chosen.end()) {
      chosen.push_back(i);
    } else if (rows[i].rel_error < rows[*same].rel_error) {
      *same = i;
    }
  }
  return chosen;
}

}  // namespace

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
  if (!report.materials.empty()) {
    BenchReport materials;
    materials.rows = report.materials;
    const BenchPlot& plot = MaterialsPlot();
    const Status status = PlotBench(materials, plot, folder / plot.file);
    if (status.ok()) {
      figures.push_back(report::Figure(plot.file, plot.caption));
    } else {
      skipped.push_back(fmt::format("{}: {}", plot.file, Message(status)));
    }
  }
  for (const size_t i : Pictured(report.rows)) {
    pictures.push_back(report::Figure(*report.rows[i].picture, NameOf(report.rows[i])));
  }
  std::string body = Section("Error and size", ErrorTable(report) + BesideFmf(report));
  body += Section("Error and time", TimeTable(report));
  body += Section("Plots; in grey what nothing beats (Pareto front)", Figures(figures));
  body += Section("Relative error by elevation",
                  AngleTable(report, "view", &ErrorsByAngleResult::by_view_theta) +
                      AngleTable(report, "light", &ErrorsByAngleResult::by_light_theta));
  if (!pictures.empty()) {
    body += Section("Apparent BRDFs",
                    Paragraph("Of a dark texel, one of middle brightness and a bright one, from above: "
                              "views down and lights across; original, decoded, and twice the "
                              "difference (white is none). Each codec at its setting of least error; "
                              "all settings are beside this page.") +
                        Figures(pictures));
  }
  body += Section("Published sizes beside ours", PublishedTables());
  body += Section("Recommendation", RecommendationTable(report));
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(
      folder / "bench.html", Page("Compression of " + report.input, report.what, body)));
  return skipped;
}

}  // namespace mesorig::report
