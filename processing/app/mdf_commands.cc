#include "processing/app/mdf_commands.h"

#include <chrono>
#include <nlohmann/json.hpp>

#include "processing/app/png_file.h"
#include "processing/btf/mdf_errors.h"
#include "processing/btf/mdf_file.h"

namespace mesorig::processing {
namespace {

using nlohmann::json;

void Print(const json& object) { fmt::print("{}\n", object.dump(2)); }

json FiguresJson(const btf::MdfFigures& f) {
  return {{"median_abs_mm", f.median_abs_mm},
          {"rmse_mm", f.rmse_mm},
          {"coverage", f.coverage},
          {"texels", f.texels},
          {"views", f.views}};
}

std::string FiguresText(const btf::MdfFigures& f) {
  return fmt::format("median |error| {:.4f} mm, rmse {:.4f} mm, coverage {:.2f} % ({} views)",
                     f.median_abs_mm, f.rmse_mm, 100 * f.coverage, f.views);
}

}  // namespace

Status MdfInfo(const std::filesystem::path& file, bool as_json) {
  MESORIG_ASSIGN_OR_RETURN(const btf::MdfFileInfo info, btf::ReadMdfInfo(file));
  const btf::MdfHeader& h = info.header;
  if (as_json) {
    json views = json::array();
    for (const Vec3& v : h.views) views.push_back({v.x, v.y, v.z});
    Print({{"kind", "mdf"},
           {"width", h.width},
           {"height", h.height},
           {"pitch_mm", h.pitch_mm},
           {"h_ref_mm", h.h_ref_mm},
           {"views", views},
           {"calibrated", h.calibrated},
           {"provenance", json::parse(h.provenance_json)},
           {"bytes", info.file_bytes}});
    return OkStatus();
  }
  fmt::print("{}: mesostructure distance function\n", file.string());
  fmt::print("  {} x {} texels of {} mm, reference plane at {} mm, {} views\n", h.width, h.height,
             h.pitch_mm, h.h_ref_mm, h.views.size());
  fmt::print("  {}, {} bytes\n", h.calibrated ? "calibrated" : "not calibrated", info.file_bytes);
  fmt::print("  provenance {}\n", h.provenance_json);
  return OkStatus();
}

Status CompareMdfFiles(const std::filesystem::path& mdf, const std::filesystem::path& truth,
                       bool by_angle, bool as_json) {
  const auto start = std::chrono::steady_clock::now();
  MESORIG_ASSIGN_OR_RETURN(const btf::Mdf left, btf::ReadMdf(mdf));
  MESORIG_ASSIGN_OR_RETURN(const btf::Mdf right, btf::ReadMdf(truth));
  const auto errors = btf::CompareMdf(left, right);
  if (!errors.ok()) {
    return Annotate(errors.status(), fmt::format("{} against {}", mdf.string(), truth.string()));
  }
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
  if (as_json) {
    json result = FiguresJson(*errors);
    result["best_plane_median_abs_mm"] = errors->best_plane_median_abs_mm;
    result["best_plane_z_mm"] = errors->best_plane_z_mm;
    result["theta_limit_deg"] = DegFromRad(btf::kMdfThetaLimit);
    for (const btf::MdfRing& ring : errors->by_view_theta) {
      if (!by_angle) break;
      result["by_view_theta"].push_back(FiguresJson(ring));
      result["by_view_theta"].back()["theta_deg"] = ring.theta_deg;
    }
    result["seconds"] = seconds.count();
    Print(result);
    return OkStatus();
  }
  fmt::print("{}\n", FiguresText(*errors));
  fmt::print("  best constant plane: z = {:.3f} mm, median |error| {:.4f} mm\n",
             errors->best_plane_z_mm, errors->best_plane_median_abs_mm);
  for (const btf::MdfRing& ring : errors->by_view_theta) {
    if (by_angle) fmt::print("  views at {:5.1f} deg: {}\n", ring.theta_deg, FiguresText(ring));
  }
  return OkStatus();
}

Status SliceMdf(const std::filesystem::path& path, int view, const std::filesystem::path& png,
                bool as_json) {
  MESORIG_ASSIGN_OR_RETURN(const btf::Mdf mdf, btf::ReadMdf(path));
  const btf::MdfHeader& h = mdf.header();
  if (view < 0 || view >= h.view_count()) {
    return InvalidArgument("{}: view {}, permitted are 0 to {}", path.string(), view,
                           h.view_count() - 1);
  }
  const double per_mm = h.views[static_cast<size_t>(view)].z / h.h_ref_mm;
  std::vector<float> rgb;
  size_t measured = 0;
  for (size_t k = 0; k < h.texel_count(); ++k) {
    const float grey = 1 - mdf.Distance(view)[k] * static_cast<float>(per_mm);
    const bool seen = mdf.Confidence(view)[k] > 0;
    measured += seen ? 1 : 0;
    rgb.insert(rgb.end(), {seen ? grey : 0.4f + 0.6f * grey, seen ? grey : 0.5f * grey,
                           seen ? grey : 0.5f * grey});
  }
  MESORIG_RETURN_IF_ERROR(
      WritePng(PictureOf(h.width, h.height, rgb, 1.0, /*code_values=*/true), png));
  const double coverage = static_cast<double>(measured) / static_cast<double>(h.texel_count());
  if (as_json) {
    Print(
        {{"file", png.string()}, {"width", h.width}, {"height", h.height}, {"coverage", coverage}});
  } else {
    fmt::print("{}: {} x {}, {:.1f} % measured\n", png.string(), h.width, h.height, 100 * coverage);
  }
  return OkStatus();
}

}  // namespace mesorig::processing
