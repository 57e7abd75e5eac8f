#include "processing/report/report.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "processing/report/figures.h"
#include "processing/report/html.h"
#include "processing/report/plots.h"
#include "protocol/base/file_writer.h"

namespace mesorig::report {
namespace {

using nlohmann::json;
using Rows = std::vector<std::vector<std::string>>;

std::string Text(std::optional<double> value, int digits, std::string_view unit = "") {
  if (!value) return "–";
  return fmt::format("{:.{}f}{}{}", *value, digits, unit.empty() ? "" : " ", unit);
}

std::string Significant(std::optional<double> value) {
  return value ? fmt::format("{:.3g}", *value) : "–";
}

// Collects the page, and what is not on it.
class Builder {
 public:
  Builder(const json& report, std::filesystem::path folder)
      : report_(report), folder_(std::move(folder)) {}

  std::string Build() {
    Stages();
    Capture();
    Quality();
    Mesostructure();
    Codecs();
    RenderAndReal();
    Pictures();
    if (!result.skipped.empty()) {
      std::string list = "<ul class=\"skipped\">\n";
      for (const std::string& line : result.skipped) list += "<li>" + Escaped(line) + "</li>\n";
      body_ += Section("Not in this report", list + "</ul>\n");
    }
    const std::string title = TextIn(report_, "title"), sample = TextIn(report_, "sample");
    return Page(title.empty() ? "Material capture report" : title,
                sample.empty() ? "mesorig" : "Sample: " + sample, body_);
  }

  ReportResult result;

 private:
  void Skip(std::string_view what, std::string_view why) {
    result.skipped.push_back(fmt::format("{}: {}", what, why));
  }

  // A table of one object's numbers; says so when the object is missing.
  bool Has(std::string_view what, std::initializer_list<const char*> path, const json*& object) {
    object = Find(report_, path);
    if (object != nullptr && object->is_object() && !object->empty()) return true;
    std::string name;
    for (const char* key : path) name += (name.empty() ? "" : ".") + std::string(key);
    Skip(what, "report.json has no " + name);
    return false;
  }

  std::string PlotFigure(std::string_view what, const char* file, std::string_view caption,
                         Status (*plot)(const json&, const std::filesystem::path&)) {
    const Status status = plot(report_, folder_ / file);
    if (!status.ok()) {
      Skip(what, Message(status));
      return "";
    }
    result.plots.emplace_back(file);
    return report::Figure(file, caption);
  }

  void Stages() {
    const json* stages = Find(report_, {"stages"});
    Rows rows = {{"stage", "wall time, s", "what it gave"}};
    for (const json& stage : stages != nullptr && stages->is_array() ? *stages : json::array()) {
      rows.push_back({TextIn(stage, "name"), Text(NumberIn(stage, "wall_s"), 2),
                      TextIn(stage, "figure")});
    }
    if (rows.size() == 1) return Skip("stages", "report.json has no stages");
    const std::string plot = PlotFigure("plot of the stages", "plot_stages.png",
                                        "Wall time of every stage.", PlotStages);
    body_ += Section("Stages", Table(rows) + (plot.empty() ? "" : report::Figures({plot})));
  }

  void Capture() {
    const json* c = nullptr;
    if (!Has("capture", {"capture"}, c)) return;
    body_ += Section(
        "Capture", Table({{"frames planned", "frames on disk", "time of the rig, s", "wall time, s"},
                          {Text(NumberIn(*c, "frames_planned"), 0),
                           Text(NumberIn(*c, "frames_on_disk"), 0),
                           Text(NumberIn(*c, "virtual_s"), 1), Text(NumberIn(*c, "wall_s"), 1)}}));
  }

  void Quality() {
    const json* b = nullptr;
    if (!Has("error of the BTF", {"btf"}, b)) return;
    Rows rows = {{"PSNR, dB", "relative error", "wall time, s"},
                 {Text(NumberIn(*b, "psnr_db"), 2), Text(NumberIn(*b, "rel_error"), 4),
                  Text(NumberIn(*b, "wall_s"), 2)}};
    if (const auto nominal = NumberIn(*b, "psnr_nominal_db")) {
      rows[0].emplace_back("PSNR, dB, at nominal directions");
      rows[1].push_back(Text(nominal, 2));
    }
    std::string html = Table(rows);
    const std::string plot =
        PlotFigure("error against angle", "plot_error_by_angle.png",
                   "Error of the measured BTF against the polar angle of view and light.",
                   PlotErrorByAngle);
    if (!plot.empty()) html += report::Figures({plot});
    body_ += Section("Measured BTF against the truth",
                     Paragraph("PSNR has the peak 1/π per steradian, a white diffuser that faces "
                               "the light.") + html);
  }

  void Mesostructure() {
    const json* m = nullptr;
    if (!Has("error of the MDF", {"mdf"}, m)) return;
    const auto percent = [](std::optional<double> share) {
      if (share) *share *= 100;
      return Text(share, 1, "%");
    };
    std::string html = Table(
        {{"median |error|, mm", "RMSE, mm", "coverage", "best plane's median |error|, mm",
          "wall time, s"},
         {Text(NumberIn(*m, "median_abs_mm"), 3), Text(NumberIn(*m, "rmse_mm"), 3),
          percent(NumberIn(*m, "coverage")), Text(NumberIn(*m, "best_plane_median_abs_mm"), 3),
          Text(NumberIn(*m, "wall_s"), 2)}});
    Rows rows = {{"view at, degrees", "median |error|, mm", "RMSE, mm", "coverage"}};
    const json* rings = Find(*m, {"by_view_theta"});
    for (const json& e : rings != nullptr && rings->is_array() ? *rings : json::array()) {
      rows.push_back({Text(NumberIn(e, "theta_deg"), 1), Text(NumberIn(e, "median_abs_mm"), 3),
                      Text(NumberIn(e, "rmse_mm"), 3), percent(NumberIn(e, "coverage"))});
    }
    if (rows.size() > 1) html += Table(rows);
    body_ += Section("Mesostructure against the truth",
                     Paragraph("Distance from the reference plane along the view, over the texels "
                               "that a laser sweep reached, first of the views within 60 degrees, "
                               "beside what the best constant plane would give, then ring by ring.") + html);
  }

  void Codecs() {
    Rows rows = {{"codec", "terms", "size, MB", "ratio", "PSNR, dB", "relative error", "encoding, s"}};
    const auto add = [&](const json& e, const std::string& name) {
      auto bytes = NumberIn(e, "bytes");
      if (bytes) *bytes *= 1e-6;
      rows.push_back({name, Text(NumberIn(e, "terms"), 0), Significant(bytes),
                      Text(NumberIn(e, "ratio"), 1), Text(NumberIn(e, "psnr_db"), 2),
                      Text(NumberIn(e, "rel_error"), 4), Text(NumberIn(e, "encode_s"), 2)});
    };
    const json* chosen = nullptr;
    if (Has("compression", {"codec", "view_svd"}, chosen)) add(*chosen, "view-svd (shipped)");
    const json* sweep = Find(report_, {"codec", "sweep"});
    for (const json& e : sweep != nullptr && sweep->is_array() ? *sweep : json::array()) {
      const std::string name = TextIn(e, "codec");
      add(e, name.empty() ? "view-svd" : name);
    }
    if (rows.size() == 1) return;
    std::string html = Table(rows);
    const std::string plot = PlotFigure(
        "error against terms and size", "plot_codec_sweep.png",
        "view-svd: error and encoding time against terms; error against size (terms beside the "
        "points).", PlotSweep);
    if (!plot.empty()) html += report::Figures({plot});
    body_ += Section("Compression", html);
  }

  void RenderAndReal() {
    const json* render = nullptr;
    if (Has("rendering", {"render"}, render)) {
      Rows rows = {{"figure", "value"}};
      for (const auto& [key, value] : render->items()) {
        if (!value.is_number()) continue;
        std::string name = key;
        std::replace(name.begin(), name.end(), '_', ' ');
        rows.push_back({name, Significant(NumberIn(*render, key))});
      }
      if (rows.size() > 1) body_ += Section("Rendering", Table(rows));
    }
    const json* real = nullptr;
    if (!Has("real photographs", {"real"}, real)) return;
    Rows rows = {{"set", "PSNR, dB", "Lambert's PSNR, dB", "wall time, s"}};
    for (const auto& [name, e] : real->items()) {
      rows.push_back({name, Text(NumberIn(e, "psnr_db"), 2),
                      Text(NumberIn(e, "lambert_psnr_db"), 2), Text(NumberIn(e, "wall_s"), 2)});
    }
    body_ += Section("Real photographs, each light predicted from the others", Table(rows));
  }

  // A plain relative path of a file that is there.
  bool Shown(const std::string& file) {
    const std::filesystem::path path(file);
    bool plain = !file.empty() && path.is_relative() && file.find(':') == std::string::npos;
    for (const auto& part : path) plain = plain && part != "..";
    if (!plain) {
      Skip("picture \"" + file + "\"", "is no path below the report's folder");
      return false;
    }
    std::error_code ignored;
    if (!std::filesystem::is_regular_file(folder_ / path, ignored)) {
      Skip("picture " + file, "the file is not there");
      return false;
    }
    return true;
  }

  void Pictures() {
    const json* pictures = Find(report_, {"pictures"});
    if (pictures == nullptr || !pictures->is_array() || pictures->empty()) {
      return Skip("pictures", "report.json has no pictures");
    }
    std::vector<std::pair<std::string, std::vector<std::string>>> groups;  // in order of the file
    for (const json& p : *pictures) {
      const std::string file = TextIn(p, "file");
      if (!Shown(file)) continue;
      const std::string section = TextIn(p, "section").empty() ? "Pictures" : TextIn(p, "section");
      if (groups.empty() || groups.back().first != section) groups.push_back({section, {}});
      groups.back().second.push_back(report::Figure(file, TextIn(p, "caption")));
    }
    for (const auto& [heading, figures] : groups) {
      body_ += Section(heading, report::Figures(figures));
    }
  }

  const json& report_;
  const std::filesystem::path folder_;
  std::string body_;
};

std::filesystem::path FolderOf(const std::filesystem::path& file) {
  return std::filesystem::weakly_canonical(std::filesystem::absolute(file)).parent_path();
}

}  // namespace

StatusOr<ReportResult> WriteReport(const std::filesystem::path& report_json,
                                   const std::filesystem::path& html) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(report_json));
  json report;
  try {
    report = json::parse(text);
  } catch (const json::exception& error) {
    return InvalidArgument("{}: {}", report_json.string(), error.what());
  }
  if (!report.is_object()) return InvalidArgument("{}: is no JSON object", report_json.string());
  if (FolderOf(report_json) != FolderOf(html)) {
    return InvalidArgument("{} must lie beside {}: its pictures are linked from there",
                           html.string(), report_json.string());
  }
  Builder builder(report, FolderOf(html));
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(html, builder.Build()));
  return builder.result;
}

}  // namespace mesorig::report
