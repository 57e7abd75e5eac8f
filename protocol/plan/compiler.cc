// Plan file to steps. Order: turntable and arc outermost (they are slow), lamps innermost; each
// axis grid is walked to and fro, so that no move is longer than needed. The last axis of the rig
// moves fastest.

#include <algorithm>
#include <cmath>

#include "protocol/base/file_writer.h"
#include "protocol/base/toml_reader.h"
#include "protocol/plan/plan.h"
#include "protocol/rig/rig_geometry.h"

namespace mesorig {
namespace {

// One [[grid]]: every combination of the axes' angles, lamps and cameras.
struct Grid {
  std::vector<std::vector<double>> axis_rad;  // per Rig::axes, in the order of the file
  std::vector<int> lamps, cameras;
  double exposure_s = 0;
};

std::vector<double> ReadAngles(TomlTable grid, const Axis& axis) {
  std::vector<double> degrees;
  if (grid.Has("angles_deg")) {
    degrees = grid.Numbers("angles_deg");
    if (degrees.empty()) grid.Error("angles_deg", "is empty");
  } else {
    const double start = grid.Number("start_deg"), step = grid.NumberOr("step_deg", 0);
    const auto count = grid.Integer("count", {1, 100000});
    for (int64_t i = 0; i < count; ++i) degrees.push_back(start + static_cast<double>(i) * step);
  }
  for (double& a : degrees) {
    // Degrees in files are decimal: a limit that is written as the same number must hold exactly.
    const double rad = RadFromDeg(a);
    if (rad < axis.min_rad - 1e-12 || rad > axis.max_rad + 1e-12) {
      grid.Error("", fmt::format("axis {} to {} deg, its limits are {} to {} deg", axis.name, a,
                                 DegFromRad(axis.min_rad), DegFromRad(axis.max_rad)));
      return {};
    }
    a = std::clamp(rad, axis.min_rad, axis.max_rad);
  }
  return degrees;
}

template <typename Find, typename Items>
std::vector<int> ReadNames(TomlTable& t, std::string_view key, const Items& items, Find find) {
  std::vector<int> indices;
  if (!t.Has(key)) {  // all
    for (size_t i = 0; i < items.size(); ++i) indices.push_back(static_cast<int>(i));
    return indices;
  }
  for (const std::string& name : t.Strings(key)) {
    const std::optional<int> index = find(name);
    if (!index) {
      t.Error(key, fmt::format("names \"{}\", which the rig does not have", name));
    } else if (std::find(indices.begin(), indices.end(), *index) != indices.end()) {
      t.Error(key, fmt::format("names \"{}\" twice", name));
    } else {
      indices.push_back(*index);
    }
  }
  std::sort(indices.begin(), indices.end());
  return indices;
}

Grid ReadGrid(TomlTable t, const Rig& rig) {
  Grid grid;
  TomlTable axes = t.Table("axes");
  for (const Axis& axis : rig.axes) grid.axis_rad.push_back(ReadAngles(axes.Table(axis.name), axis));
  grid.lamps = ReadNames(t, "lamps", rig.lamps, [&](auto& n) { return rig.FindLamp(n); });
  grid.cameras = ReadNames(t, "cameras", rig.cameras, [&](auto& n) { return rig.FindCamera(n); });
  if (grid.lamps.empty()) t.Error("lamps", "is empty");
  if (grid.cameras.empty()) t.Error("cameras", "is empty");
  grid.exposure_s = t.Number("exposure_s");
  for (const int c : grid.cameras) {
    const Camera& camera = rig.cameras[c];
    if (grid.exposure_s < camera.min_exposure_s || grid.exposure_s > camera.max_exposure_s) {
      t.Error("exposure_s", fmt::format("is {} s, camera {} does {} to {} s", grid.exposure_s,
                                        camera.name, camera.min_exposure_s, camera.max_exposure_s));
    }
  }
  return grid;
}

// Emits steps and keeps the running estimate.
class Emitter {
 public:
  Emitter(const Rig& rig, CompiledPlan& plan) : rig_(rig), plan_(plan) {
    at_.assign(rig.axes.size(), 0.0);  // home
  }

  void MoveTo(const std::vector<double>& axis_rad) {
    if (moved_ && axis_rad == at_) return;
    moved_ = true;
    double seconds = 0;
    for (size_t i = 0; i < at_.size(); ++i) {
      seconds = std::max(seconds, MoveSeconds(rig_.axes[i], axis_rad[i] - at_[i]));
    }
    plan_.seconds += seconds;
    at_ = axis_rad;
    Step step;
    step.kind = StepKind::kMoveAxes;
    step.axis_rad = axis_rad;
    plan_.steps.push_back(step);
  }
  void Lamp(int lamp) {
    Step step;
    step.kind = StepKind::kLamp;
    step.lamp = lamp;
    plan_.steps.push_back(step);
    if (lamp < 0) return;
    plan_.seconds += rig_.lamps[lamp].settle_s;
    plan_.lamp_seconds += rig_.lamps[lamp].settle_s;
  }
  void Shoot(const std::vector<int>& cameras, double exposure_s) {
    Step step;
    step.kind = StepKind::kShot;
    step.shot = plan_.shots++;
    step.exposure_s = exposure_s;
    step.cameras = cameras;
    plan_.steps.push_back(step);
    double readout = 0;
    for (const int camera : cameras) {
      readout = std::max(readout, rig_.cameras[camera].readout_s);
      plan_.frame_bytes += rig_.cameras[camera].frame_bytes();
    }
    plan_.frames += static_cast<uint32_t>(cameras.size());
    plan_.seconds += exposure_s + readout;
    plan_.lamp_seconds += exposure_s + readout;
  }

 private:
  const Rig& rig_;
  CompiledPlan& plan_;
  std::vector<double> at_;
  bool moved_ = false;
};

// All lamps and cameras at one position of the axes.
void EmitPosition(const Rig& rig, const Grid& grid, const std::vector<double>& axis_rad,
                  Emitter& emitter, CompiledPlan& plan) {
  std::vector<int> cameras;
  for (const int c : grid.cameras) {
    const Vec3 camera = WorldFromCamera(rig, c, axis_rad).translation;
    if (!BlockedBy(rig, camera, axis_rad)) cameras.push_back(c);
  }
  std::vector<int> lamps;
  for (const int l : grid.lamps) {
    if (!BlockedBy(rig, LampInWorld(rig, l, axis_rad), axis_rad)) lamps.push_back(l);
  }
  plan.frames_blocked +=
      static_cast<uint32_t>(grid.cameras.size() * grid.lamps.size() - cameras.size() * lamps.size());
  if (cameras.empty() || lamps.empty()) return;
  emitter.MoveTo(axis_rad);
  for (const int lamp : lamps) {
    emitter.Lamp(lamp);
    emitter.Shoot(cameras, grid.exposure_s);
  }
}

// Walks the product of the axes' angles in boustrophedon order.
void EmitGrid(const Rig& rig, const Grid& grid, Emitter& emitter, CompiledPlan& plan) {
  const size_t axes = grid.axis_rad.size();
  std::vector<size_t> index(axes, 0);
  std::vector<int> direction(axes, 1);
  for (;;) {
    std::vector<double> axis_rad(axes);
    for (size_t i = 0; i < axes; ++i) axis_rad[i] = grid.axis_rad[i][index[i]];
    EmitPosition(rig, grid, axis_rad, emitter, plan);
    size_t turn = axes;
    while (turn > 0) {
      const size_t i = turn - 1;
      const bool at_end = direction[i] > 0 ? index[i] + 1 == grid.axis_rad[i].size() : index[i] == 0;
      if (!at_end) {
        index[i] = direction[i] > 0 ? index[i] + 1 : index[i] - 1;
        break;
      }
      direction[i] = -direction[i];
      --turn;
    }
    if (turn == 0) return;
  }
}

Product ReadProduct(TomlTable t) {
  Product product;
  product.width_px = static_cast<int>(t.Integer("width_px", {1, 16384}));
  product.height_px = static_cast<int>(t.Integer("height_px", {1, 16384}));
  product.pitch_mm = t.Number("pitch_mm", {1e-4, 100});
  product.h_ref_mm = t.Number("h_ref_mm", {0, 1000});
  return product;
}

}  // namespace

StatusOr<CompiledPlan> CompilePlan(std::string_view text, std::string_view name, const Rig& rig) {
  MESORIG_ASSIGN_OR_RETURN(TomlFile file, TomlFile::Parse(text, name));
  TomlTable root = file.root();
  CompiledPlan plan;
  plan.name = root.String("name");
  plan.sample_name = root.Table("sample").String("name");
  plan.rig_sha256 = rig.sha256;
  plan.product = ReadProduct(root.Table("product"));
  std::vector<Grid> grids;
  for (TomlTable t : root.Tables("grid")) grids.push_back(ReadGrid(t, rig));
  if (grids.empty()) root.Error("", "at least one [[grid]] is needed");
  MESORIG_RETURN_IF_ERROR(file.Finish());
  Emitter emitter(rig, plan);
  for (const Grid& grid : grids) EmitGrid(rig, grid, emitter, plan);
  if (plan.frames == 0) {
    return InvalidArgument("{}: every frame is blocked by a solid of the rig ({} of {})", name,
                           plan.frames_blocked, plan.frames_blocked);
  }
  emitter.Lamp(-1);
  return plan;
}

StatusOr<CompiledPlan> CompilePlanFile(const std::filesystem::path& path, const Rig& rig) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, 4u << 20));
  return CompilePlan(text, path.string(), rig);
}

}  // namespace mesorig
