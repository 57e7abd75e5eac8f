#include "processing/app/mdf_commands.h"

#include <nlohmann/json.hpp>

#include "processing/btf/mdf_file.h"

namespace mesorig::processing {
namespace {

using nlohmann::json;

void Print(const json& object) { fmt::print("{}\n", object.dump(2)); }

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

}  // namespace mesorig::processing
