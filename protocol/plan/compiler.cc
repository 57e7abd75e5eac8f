// Plan file to steps. Order: turntable and arc outermost (they are slow), lamps innermost; each
// axis grid is walked to and fro, so that no move is longer than needed. The last axis of the rig
// moves fastest. Sweeps come after all grids; of all sweeps those of one laser mount together, so
// that the operator is asked once for each.

#include <algorithm>
#include <cmath>
#include <utility>

#include "protocol/base/file_writer.h"
#include "protocol/base/toml_reader.h"
#include "protocol/plan/plan.h"
#include "protocol/rig/rig_geometry.h"

namespace mesorig {
namespace {

using AxisAngles = std::vector<std::vector<double>>;  // per Rig::axes, in the order of the file

// One [[grid]]: every combination of the axes' angles, lamps and cameras.
struct Grid {
  AxisAngles axis_rad;
  std::vector<int> lamps, cameras;
  double exposure_s = 0;
};

// One [[sweep]]: every combination of mounts and the axes' angles.
struct SweepGrid {
  AxisAngles axis_rad;
  std::vector<int> mounts, cameras;
  double exposure_s = 0, frame_rate_hz = 0, from_mm = 0, to_mm = 0, region_radius_mm = 0;
  uint32_t frames = 0;
  bool keep_frames = true;
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

AxisAngles ReadAxes(TomlTable& t, const Rig& rig) {
  AxisAngles angles;
  TomlTable axes = t.Table("axes");
  for (const Axis& axis : rig.axes) angles.push_back(ReadAngles(axes.Table(axis.name), axis));
  return angles;
}

std::vector<int> ReadCameras(TomlTable& t, const Rig& rig) {
  auto cameras = ReadNames(t, "cameras", rig.cameras, [&](auto& n) { return rig.FindCamera(n); });
  if (cameras.empty()) t.Error("cameras", "is empty");
  return cameras;
}

double ReadExposure(TomlTable& t, const Rig& rig, const std::vector<int>& cameras) {
  const double exposure_s = t.Number("exposure_s");
  for (const int c : cameras) {
    const Camera& camera = rig.cameras[c];
    if (exposure_s < camera.min_exposure_s || exposure_s > camera.max_exposure_s) {
      t.Error("exposure_s", fmt::format("is {} s, camera {} does {} to {} s", exposure_s,
                                        camera.name, camera.min_exposure_s, camera.max_exposure_s));
    }
  }
  return exposure_s;
}

Grid ReadGrid(TomlTable t, const Rig& rig) {
  Grid grid;
  grid.axis_rad = ReadAxes(t, rig);
  grid.lamps = ReadNames(t, "lamps", rig.lamps, [&](auto& n) { return rig.FindLamp(n); });
  if (grid.lamps.empty()) t.Error("lamps", "is empty");
  grid.cameras = ReadCameras(t, rig);
  grid.exposure_s = ReadExposure(t, rig, grid.cameras);
  return grid;
}

// The tilt whose stripe crosses the turntable at x (docs/laser.md).
double TiltOfStripe(const LaserMount& mount, double x_mm) {
  const double away = mount.distance_mm * std::sin(mount.theta_rad) - x_mm;
  return std::atan2(away, mount.distance_mm * std::cos(mount.theta_rad)) - mount.theta_rad;
}

void CheckSweep(TomlTable& t, const Rig& rig, const SweepGrid& sweep) {
  for (const char* key : {"from_mm", "to_mm"}) {
    const double x = key[0] == 'f' ? sweep.from_mm : sweep.to_mm;
    for (const int m : sweep.mounts) {
      const LaserMount& mount = rig.laser->mounts[m];
      const double tilt = TiltOfStripe(mount, x);
      if (std::abs(tilt) <= rig.laser->max_tilt_rad) continue;
      t.Error(key, fmt::format("needs the laser at {} tilted by {:.2f} deg, it does {:.2f} to both "
                               "sides",
                               mount.name, DegFromRad(tilt), DegFromRad(rig.laser->max_tilt_rad)));
    }
  }
  if (sweep.from_mm == sweep.to_mm) t.Error("to_mm", "is where the sweep starts");
  for (const int c : sweep.cameras) {
    const double needed = sweep.exposure_s + rig.cameras[c].readout_s;
    if (needed * sweep.frame_rate_hz <= 1) continue;
    t.Error("frame_rate_hz",
            fmt::format("is {}, camera {} exposes and reads out in {:.4f} s: at "
                        "most {:.2f}",
                        sweep.frame_rate_hz, rig.cameras[c].name, needed, 1 / needed));
  }
}

SweepGrid ReadSweep(TomlTable t, const Rig& rig) {
  SweepGrid sweep;
  sweep.axis_rad = ReadAxes(t, rig);
  sweep.cameras = ReadCameras(t, rig);
  sweep.exposure_s = ReadExposure(t, rig, sweep.cameras);
  sweep.frame_rate_hz = t.Number("frame_rate_hz", {0.01, 1000});
  sweep.frames = static_cast<uint32_t>(t.Integer("frames", {3, 100000}));
  sweep.from_mm = t.Number("from_mm", {-1e4, 1e4});
  sweep.to_mm = t.Number("to_mm", {-1e4, 1e4});
  sweep.region_radius_mm = t.Number("region_radius_mm", {1, 1e4});
  sweep.keep_frames = t.Word("keep", {"frames", "displacements"}) == "frames";
  if (!rig.laser) {
    (void)t.Has("mounts");
    t.Error("", "the rig has no [laser]");
    return sweep;
  }
  sweep.mounts =
      ReadNames(t, "mounts", rig.laser->mounts, [&](auto& n) { return rig.FindMount(n); });
  if (sweep.mounts.empty()) t.Error("mounts", "is empty");
  CheckSweep(t, rig, sweep);
  return sweep;
}

// The way back of the emitter and its run-up, s.
constexpr double kSweepStart_s = 2;

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
  void Mount(int mount) {
    Step step;
    step.kind = StepKind::kMount;
    step.sweep.mount = mount;
    plan_.steps.push_back(step);
    ++plan_.prompts;
  }
  void RunSweep(const std::vector<int>& cameras, double exposure_s, Sweep sweep) {
    sweep.index = plan_.sweeps++;
    plan_.frames += sweep.frames * static_cast<uint32_t>(cameras.size());
    plan_.seconds += kSweepStart_s + sweep.frames / sweep.frame_rate_hz;
    for (size_t k = 0; k < cameras.size(); ++k) {
      const Region& region = sweep.regions[k];
      plan_.frame_bytes += static_cast<uint64_t>(sweep.frames) *
                           static_cast<uint64_t>(region.width) *
                           static_cast<uint64_t>(region.height) *
                           static_cast<uint64_t>(rig_.cameras[cameras[k]].bytes_per_pixel());
    }
    Step step;
    step.kind = StepKind::kSweep;
    step.shot = plan_.shots;
    step.exposure_s = exposure_s;
    step.cameras = cameras;
    plan_.shots += sweep.frames;
    step.sweep = std::move(sweep);
    plan_.steps.push_back(std::move(step));
  }

 private:
  const Rig& rig_;
  CompiledPlan& plan_;
  std::vector<double> at_;
  bool moved_ = false;
};

std::vector<int> UnblockedCameras(const Rig& rig, const std::vector<int>& cameras,
                                  const std::vector<double>& axis_rad) {
  std::vector<int> free;
  for (const int c : cameras) {
    const Vec3 camera = WorldFromCamera(rig, c, axis_rad).translation;
    if (!BlockedBy(rig, camera, axis_rad)) free.push_back(c);
  }
  return free;
}

// All lamps and cameras at one position of the axes.
void EmitPosition(const Rig& rig, const Grid& grid, const std::vector<double>& axis_rad,
                  Emitter& emitter, CompiledPlan& plan) {
  const std::vector<int> cameras = UnblockedCameras(rig, grid.cameras, axis_rad);
  std::vector<int> lamps;
  for (const int l : grid.lamps) {
    if (!BlockedBy(rig, LampInWorld(rig, l, axis_rad), axis_rad)) lamps.push_back(l);
  }
  plan.frames_blocked += static_cast<uint32_t>(grid.cameras.size() * grid.lamps.size() -
                                               cameras.size() * lamps.size());
  if (cameras.empty() || lamps.empty()) return;
  emitter.MoveTo(axis_rad);
  for (const int lamp : lamps) {
    emitter.Lamp(lamp);
    emitter.Shoot(cameras, grid.exposure_s);
  }
}

// Walks the product of the axes' angles in boustrophedon order.
template <typename Visit>
void VisitPositions(const AxisAngles& angles, Visit visit) {
  const size_t axes = angles.size();
  std::vector<size_t> index(axes, 0);
  std::vector<int> direction(axes, 1);
  for (;;) {
    std::vector<double> axis_rad(axes);
    for (size_t i = 0; i < axes; ++i) axis_rad[i] = angles[i][index[i]];
    visit(axis_rad);
    size_t turn = axes;
    while (turn > 0) {
      const size_t i = turn - 1;
      const bool at_end = direction[i] > 0 ? index[i] + 1 == angles[i].size() : index[i] == 0;
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

void EmitSweepPosition(const Rig& rig, const SweepGrid& grid, int mount,
                       const std::vector<double>& axis_rad, double h_ref_mm, Emitter& emitter,
                       CompiledPlan& plan) {
  std::vector<int> cameras = UnblockedCameras(rig, grid.cameras, axis_rad);
  if (BlockedBy(rig, LaserInWorld(rig, mount, axis_rad).source, axis_rad)) cameras.clear();
  Sweep sweep;
  std::vector<int> seeing;
  for (const int c : cameras) {
    const auto region = RegionOfDisc(rig, c, axis_rad, grid.region_radius_mm, h_ref_mm);
    if (!region) continue;
    seeing.push_back(c);
    sweep.regions.push_back(*region);
  }
  plan.frames_blocked += grid.frames * static_cast<uint32_t>(grid.cameras.size() - seeing.size());
  if (seeing.empty()) return;
  sweep.mount = mount;
  sweep.tilt_from_rad = TiltOfStripe(rig.laser->mounts[mount], grid.from_mm);
  sweep.tilt_to_rad = TiltOfStripe(rig.laser->mounts[mount], grid.to_mm);
  sweep.frames = grid.frames;
  sweep.frame_rate_hz = grid.frame_rate_hz;
  sweep.keep_frames = grid.keep_frames;
  emitter.MoveTo(axis_rad);
  emitter.RunSweep(seeing, grid.exposure_s, std::move(sweep));
}

void EmitSweeps(const Rig& rig, const std::vector<SweepGrid>& sweeps, Emitter& emitter,
                CompiledPlan& plan) {
  const int mounts = rig.laser ? static_cast<int>(rig.laser->mounts.size()) : 0;
  for (int mount = 0; mount < mounts; ++mount) {
    bool asked = false;
    for (const SweepGrid& sweep : sweeps) {
      if (std::find(sweep.mounts.begin(), sweep.mounts.end(), mount) == sweep.mounts.end())
        continue;
      if (!std::exchange(asked, true)) emitter.Mount(mount);
      VisitPositions(sweep.axis_rad, [&](const std::vector<double>& axis_rad) {
        EmitSweepPosition(rig, sweep, mount, axis_rad, plan.product.h_ref_mm, emitter, plan);
      });
    }
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
  TomlTable sample = root.Table("sample");
  plan.sample_name = sample.String("name");
  plan.sample_extent_mm = sample.NumberOr("extent_mm", 0, {0.1, 1e4});
  plan.rig_sha256 = rig.sha256;
  plan.product = ReadProduct(root.Table("product"));
  std::vector<Grid> grids;
  for (TomlTable t : root.Tables("grid")) grids.push_back(ReadGrid(t, rig));
  std::vector<SweepGrid> sweeps;
  for (TomlTable t : root.Tables("sweep")) sweeps.push_back(ReadSweep(t, rig));
  if (grids.empty() && sweeps.empty()) {
    root.Error("", "at least one [[grid]] or [[sweep]] is needed");
  }
  if (!sweeps.empty() && plan.sample_extent_mm == 0) {
    sample.Error("", "sweeps need extent_mm, the side of the sample's square footprint");
  }
  MESORIG_RETURN_IF_ERROR(file.Finish());
  Emitter emitter(rig, plan);
  for (const Grid& grid : grids) {
    VisitPositions(grid.axis_rad, [&](const std::vector<double>& axis_rad) {
      EmitPosition(rig, grid, axis_rad, emitter, plan);
    });
  }
  emitter.Lamp(-1);
  EmitSweeps(rig, sweeps, emitter, plan);
  if (plan.frames == 0) {
    return InvalidArgument("{}: every frame is blocked by a solid of the rig ({} of {})", name,
                           plan.frames_blocked, plan.frames_blocked);
  }
  return plan;
}

StatusOr<CompiledPlan> CompilePlanFile(const std::filesystem::path& path, const Rig& rig) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, 4u << 20));
  return CompilePlan(text, path.string(), rig);
}

}  // namespace mesorig
