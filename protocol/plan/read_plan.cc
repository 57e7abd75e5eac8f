#include <algorithm>
#include <cmath>

#include "protocol/base/digest.h"
#include "protocol/plan/fits_rig.h"
#include "protocol/plan/plan_source.h"
#include "protocol/plan/read_directions.h"
#include "protocol/plan/timing.h"

namespace mesorig {
namespace {

constexpr double kClearance_mm = 0.2;  // of the reference plane over the sample

std::vector<int> Union(std::vector<int> a, const std::vector<int>& b) {
  a.insert(a.end(), b.begin(), b.end());
  std::sort(a.begin(), a.end());
  a.erase(std::unique(a.begin(), a.end()), a.end());
  return a;
}

// What a plan may ask for at most: beyond, somebody slipped by a zero.
constexpr double kMaxStations = 100'000, kMaxFrames = 50e6;

void CheckCount(TomlTable& t, double stations, double frames_a_station) {
  if (stations > kMaxStations) {
    t.Error("", fmt::format("asks for {} positions of the axes, permitted is {}", stations,
                            kMaxStations));
  } else if (stations * frames_a_station > kMaxFrames) {
    t.Error("", fmt::format("asks for {} frames, permitted is {}", stations * frames_a_station,
                            kMaxFrames));
  }
}

double Positions(const std::vector<std::vector<double>>& axis_rad) {
  double positions = 1;
  for (const auto& angles : axis_rad) positions *= static_cast<double>(angles.size());
  return positions;
}

double FramesAStation(const DirectionSet& set, size_t lamps, size_t cameras) {
  const size_t shots = set.exposures.metered() ? 1 : set.exposures.bracket_s.size();
  return static_cast<double>(shots) * set.repeats * static_cast<double>(lamps * cameras);
}

DirectionSet ReadGrid(TomlTable t, const Rig& rig) {
  DirectionSet grid;
  grid.where = t.Where();
  grid.axis_rad = ReadAxes(t, rig);
  grid.lamps = ReadLamps(t, rig);
  grid.cameras = ReadCameras(t, rig);
  grid.exposures = ReadExposures(t, rig, grid.cameras);
  grid.repeats = ReadRepeats(t);
  grid.settle_s = ReadSettle(t);
  CheckCount(t, Positions(grid.axis_rad),
             FramesAStation(grid, grid.lamps.size(), grid.cameras.size()));
  return grid;
}

DirectionSet ReadList(TomlTable t, const Rig& rig) {
  DirectionSet list;
  list.where = t.Where();
  list.is_grid = false;
  const std::vector<int> lamps = ReadLamps(t, rig), cameras = ReadCameras(t, rig);
  std::vector<int> used;
  for (TomlTable p : t.Tables("position")) {
    Station station;
    station.where = p.Where();
    station.axis_rad = ReadAxesAngles(p, rig);
    station.lamps = p.Has("lamps") ? ReadLamps(p, rig) : lamps;
    station.cameras = p.Has("cameras") ? ReadCameras(p, rig) : cameras;
    used = Union(used, station.cameras);
    list.stations.push_back(std::move(station));
  }
  if (list.stations.empty()) t.Error("", "at least one [[list.position]] is needed");
  list.exposures = ReadExposures(t, rig, used);
  list.repeats = ReadRepeats(t);
  list.settle_s = ReadSettle(t);
  CheckCount(t, static_cast<double>(list.stations.size()),
             FramesAStation(list, rig.lamps.size(), used.size()));
  return list;
}

// The emitter's rate, as the motor's speed.
void CheckRate(TomlTable& t, const Laser& laser, const LaserMount& mount, const SweepGrid& sweep) {
  const double tilt = TiltOfStripe(mount, sweep.to_mm) - TiltOfStripe(mount, sweep.from_mm);
  const double rate = tilt / std::max(1.0, sweep.frames - 1.0) * sweep.frame_rate_hz;
  if (tilt == 0 || SweepPower(laser, rate) > 0) return;
  const double full = DegFromRad(laser.full_speed_rad_s / laser.gear_ratio);
  t.Error("frame_rate_hz",
          fmt::format("is {:g}: with {} frames the laser at {} tilts by {:.4f} deg a second, its "
                      "motor does {:.4f} to {:.4f}",
                      sweep.frame_rate_hz, sweep.frames, mount.name, std::abs(DegFromRad(rate)),
                      full / 100, full));
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
  for (const int m : sweep.mounts) CheckRate(t, *rig.laser, rig.laser->mounts[m], sweep);
  for (const int c : sweep.cameras) {
    const double needed = sweep.exposure_s + rig.cameras[c].readout_s;
    if (needed * sweep.frame_rate_hz <= 1) continue;
    t.Error("frame_rate_hz",
            fmt::format("is {}, camera {} exposes and reads out in {:.4f} s: at most {:.2f}",
                        sweep.frame_rate_hz, rig.cameras[c].name, needed, 1 / needed));
  }
}

SweepGrid ReadSweep(TomlTable t, const Rig& rig) {
  SweepGrid sweep;
  sweep.where = t.Where();
  sweep.axis_rad = ReadAxes(t, rig);
  sweep.cameras = ReadCameras(t, rig);
  sweep.exposure_s = t.Number("exposure_s");
  CheckExposure(t, "exposure_s", sweep.exposure_s, rig, sweep.cameras, false);
  sweep.frame_rate_hz = t.Number("frame_rate_hz", {0.01, 1000});
  sweep.frames = static_cast<uint32_t>(t.Integer("frames", {3, 100000}));
  sweep.from_mm = t.Number("from_mm", {-1e4, 1e4});
  sweep.to_mm = t.Number("to_mm", {-1e4, 1e4});
  sweep.region_radius_mm = t.Number("region_radius_mm", {1, 1e4});
  sweep.keep_frames = t.Word("keep", {"frames", "displacements"}) == "frames";
  sweep.settle_s = ReadSettle(t);
  CheckCount(t, Positions(sweep.axis_rad),
             static_cast<double>(sweep.frames) * static_cast<double>(sweep.cameras.size()));
  if (!rig.laser) {
    (void)t.Has("mounts");
    t.Error("", "the rig has no [laser]");
    return sweep;
  }
  sweep.mounts = ReadMounts(t, rig);
  CheckSweep(t, rig, sweep);
  return sweep;
}

Calibration ReadCalibration(TomlTable t, const Rig& rig) {
  Calibration calibration;
  calibration.where = t.Where();
  const std::string kind = t.Word("kind", {"dark", "flat", "ambient"});
  calibration.purpose = kind == "flat"   ? Purpose::kFlat
                        : kind == "dark" ? Purpose::kDark
                                         : Purpose::kAmbient;
  const bool flat = calibration.purpose == Purpose::kFlat;
  calibration.cameras = ReadCameras(t, rig);
  if (flat && t.Has("lamps")) calibration.lamps = ReadLamps(t, rig);
  if (t.Has("exposures_s")) {
    calibration.exposures_s = t.Numbers("exposures_s", {1e-9, 1e6});
    std::sort(calibration.exposures_s.begin(), calibration.exposures_s.end());
    CheckExposureCount(t, "exposures_s", calibration.exposures_s);
    for (const double e : calibration.exposures_s) {
      CheckExposure(t, "exposures_s", e, rig, calibration.cameras, flat);
    }
  }
  calibration.repeats = ReadRepeats(t);
  return calibration;
}

OperatorPrompt ReadPrompt(TomlTable t) {
  OperatorPrompt prompt;
  prompt.text = t.String("text");
  const bool plain = std::none_of(prompt.text.begin(), prompt.text.end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20 && c != '\n';
  });
  if (!plain || prompt.text.empty() || prompt.text.size() > kMaxPromptBytes) {
    t.Error("text", fmt::format("has {} bytes, permitted is 1 to {} without control characters",
                                prompt.text.size(), kMaxPromptBytes));
  }
  prompt.before = t.Word("when", {"before", "after"}) == "before";
  return prompt;
}

Symmetry ReadSymmetry(TomlTable& t) {
  if (!t.Has("symmetry")) return Symmetry::kNone;
  const std::string word = t.Word("symmetry", {"none", "half-turn", "quarter-turn", "isotropic"});
  if (word == "half-turn") return Symmetry::kHalfTurn;
  if (word == "quarter-turn") return Symmetry::kQuarterTurn;
  return word == "isotropic" ? Symmetry::kIsotropic : Symmetry::kNone;
}

void ReadSample(TomlTable t, PlanSource& plan) {
  plan.sample.name = t.String("name");
  plan.sample.notes = t.StringOr("notes", "");
  plan.sample.thickness_mm = t.NumberOr("thickness_mm", 0, {1e-3, 1000});
  plan.sample.extent_mm = t.NumberOr("extent_mm", 0, {0.1, 1e4});
  plan.needs.symmetry = ReadSymmetry(t);
  if (t.Has("max_theta_deg")) {
    plan.needs.max_theta_rad = RadFromDeg(t.Number("max_theta_deg", {1, 90}));
  }
}

// h_ref: as written, or over the sample's thickness.
void ReadProduct(TomlTable t, TomlTable sample, PlanSource& plan) {
  Product& product = plan.product;
  product.width_px = static_cast<int>(t.Integer("width_px", {1, 16384}));
  product.height_px = static_cast<int>(t.Integer("height_px", {1, 16384}));
  product.pitch_mm = t.Number("pitch_mm", {1e-4, 100});
  const double thickness = plan.sample.thickness_mm;
  const bool has_clearance = sample.Has("clearance_mm");
  const double clearance = sample.NumberOr("clearance_mm", kClearance_mm, {0, 1000});
  if (!t.Has("h_ref_mm")) {
    product.h_ref_mm = thickness + clearance;
    if (thickness == 0) {
      t.Error("",
              "`h_ref_mm` is missing, or the thickness_mm of the [sample] that it follows from");
    }
    return;
  }
  product.h_ref_mm = t.Number("h_ref_mm", {0, 1000});
  if (product.h_ref_mm < thickness) {
    t.Error("h_ref_mm", fmt::format("is {:g} mm, below the top of the sample: thickness_mm is {:g}",
                                    product.h_ref_mm, thickness));
  }
  if (has_clearance) {
    sample.Error("clearance_mm", "says what h_ref_mm of the [product] says too: leave out one");
  }
}

void CheckWhole(TomlTable root, TomlTable sample, const PlanSource& plan) {
  if (plan.sets.empty() && plan.sweeps.empty() && plan.calibrations.empty()) {
    root.Error("", "at least one [[grid]], [[list]], [[sweep]] or [[calibration]] is needed");
  }
  if (!plan.sweeps.empty() && plan.sample.extent_mm == 0) {
    sample.Error("", "sweeps need extent_mm, the side of the sample's square footprint");
  }
}

}  // namespace

double TiltOfStripe(const LaserMount& mount, double x_mm) {
  const double away = mount.distance_mm * std::sin(mount.theta_rad) - x_mm;
  return std::atan2(away, mount.distance_mm * std::cos(mount.theta_rad)) - mount.theta_rad;
}

std::string Sha256OfSample(const SampleRecord& sample) {
  return Sha256(fmt::format("name {}:{}\nnotes {}:{}\nthickness_mm {}\nextent_mm {}\n",
                            sample.name.size(), sample.name, sample.notes.size(), sample.notes,
                            sample.thickness_mm, sample.extent_mm));
}

StatusOr<PlanSource> ReadPlan(std::string_view text, std::string_view name, const Rig& rig) {
  MESORIG_ASSIGN_OR_RETURN(TomlFile file, TomlFile::Parse(text, name));
  TomlTable root = file.root();
  PlanSource plan;
  plan.name = root.String("name");
  TomlTable sample = root.Table("sample");
  ReadSample(sample, plan);
  ReadProduct(root.Table("product"), sample, plan);
  for (TomlTable t : root.Tables("grid")) plan.sets.push_back(ReadGrid(t, rig));
  for (TomlTable t : root.Tables("list")) plan.sets.push_back(ReadList(t, rig));
  for (TomlTable t : root.Tables("sweep")) plan.sweeps.push_back(ReadSweep(t, rig));
  for (TomlTable t : root.Tables("calibration")) {
    plan.calibrations.push_back(ReadCalibration(t, rig));
  }
  for (TomlTable t : root.Tables("prompt")) plan.prompts.push_back(ReadPrompt(t));
  CheckWhole(root, sample, plan);
  MESORIG_RETURN_IF_ERROR(file.Finish());
  return plan;
}

}  // namespace mesorig
