// Reads a sample file.

#include <algorithm>
#include <cmath>

#include "protocol/base/digest.h"
#include "protocol/base/file_writer.h"
#include "protocol/base/toml_reader.h"
#include "simulator/world/sample.h"
#include "simulator/world/weave.h"

namespace mesorig::world {
namespace {

// `contrast`: how far the albedo is modulated up and down.
Material ReadMaterial(TomlTable t, double contrast) {
  Material material;
  const Vec3 diffuse = t.Vector("diffuse", {0, 1});
  material.diffuse = {diffuse.x, diffuse.y, diffuse.z};
  material.specular = t.Number("specular", {0, 1});
  material.roughness = t.Number("roughness", {kMinRoughness, 1});
  const double most = std::max({diffuse.x, diffuse.y, diffuse.z}) * (1 + contrast);
  if (most + material.specular > 1) {
    t.Error("specular", fmt::format("with the largest albedo, {}, gives more than 1", most));
  }
  return material;
}

void ReadWeave(TomlTable root, Surface& surface) {
  WeaveShape s;
  TomlTable w = root.Table("weave");
  s.pitch_mm = w.Number("pitch_mm", {0.1, 100});
  s.thread_width_mm = w.Number("thread_width_mm", {0.05, 100});
  if (s.thread_width_mm > s.pitch_mm) w.Error("thread_width_mm", "must not exceed pitch_mm");
  s.thread_height_mm = w.Number("thread_height_mm", {0, 20});
  s.sway_mm = w.Number("sway_mm", {0, 20});
  s.base_mm = w.Number("base_mm", {0, 20});
  s.twist_mm = w.Number("twist_mm", {0.01, 100});
  s.twist_contrast = w.Number("twist_contrast", {0, 1});
  s.warp = ReadMaterial(w.Table("warp"), s.twist_contrast);
  s.weft = ReadMaterial(w.Table("weft"), s.twist_contrast);
  s.ground = ReadMaterial(w.Table("ground"), 0);
  TomlTable l = root.Table("letter");
  s.letter_height_mm = l.Number("height_mm", {0.1, 100});
  s.letter_width_mm = l.Number("width_mm", {0.1, 100});
  s.letter_stroke_mm = l.Number("stroke_mm", {0.01, 100});
  s.letter_top_mm = l.Number("top_mm", {0, 20});
  s.letter_follow = l.Number("follow", {0, 1});
  s.letter_ramp_mm = l.Number("ramp_mm", {0.001, 20});
  s.letter_x_mm = l.NumberOr("x_mm", 0, {-100, 100});
  s.letter_y_mm = l.NumberOr("y_mm", 0, {-100, 100});
  s.letter = ReadMaterial(l.Table("material"), 0);
  surface.height_mm = [s](double x, double y) { return WeaveHeight(s, x, y); };
  surface.material = [s](double x, double y) { return WeaveMaterial(s, x, y); };
}

void ReadFlat(TomlTable root, Surface& surface) {
  TomlTable flat = root.Table("flat");
  const double height = flat.Number("height_mm", {0, 20});
  const Material material = ReadMaterial(flat.Table("material"), 0);
  surface.height_mm = [height](double, double) { return height; };
  surface.material = [material](double, double) { return material; };
}

}  // namespace

StatusOr<Sample> ParseSample(std::string_view text, std::string_view name) {
  MESORIG_ASSIGN_OR_RETURN(TomlFile file, TomlFile::Parse(text, name));
  TomlTable root = file.root();
  Sample sample;
  Surface& surface = sample.surface;
  surface.name = root.String("name");
  surface.extent_mm = root.Number("extent_mm", {1, 1000});
  surface.grid_mm = root.Number("grid_mm", {0.001, 100});
  const double cells = surface.grid_mm > 0 ? surface.extent_mm / surface.grid_mm : 0;
  if (cells > 4000) root.Error("grid_mm", "makes more than 4000 cells along extent_mm");
  sample.h_ref_mm = root.Number("h_ref_mm", {0, 100});
  const std::string kind = root.Word("kind", {"weave", "flat"});
  if (kind == "weave") ReadWeave(root, surface);
  if (kind == "flat") ReadFlat(root, surface);
  MESORIG_RETURN_IF_ERROR(file.Finish());
  // The highest point, at a step that no relief of a file's own numbers slips through unseen.
  double top = 0;
  const double step = surface.extent_mm / std::ceil(cells);
  for (double y = -surface.extent_mm / 2; y <= surface.extent_mm / 2; y += step) {
    for (double x = -surface.extent_mm / 2; x <= surface.extent_mm / 2; x += step) {
      top = std::max(top, surface.height_mm(x, y));
    }
  }
  if (!(top < sample.h_ref_mm)) {
    return InvalidArgument("{}: the relief rises to {} mm, h_ref_mm is {} mm: it must lie above",
                           root.Where("h_ref_mm"), top, sample.h_ref_mm);
  }
  sample.source_text = text;
  sample.sha256 = Sha256(text);
  return sample;
}

StatusOr<Sample> LoadSample(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, 1u << 20));
  return ParseSample(text, path.string());
}

}  // namespace mesorig::world
