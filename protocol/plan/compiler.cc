// From what a plan says to steps: prompts, calibration frames, metering, grids and lists, then
// sweeps, those of one laser mount together, so that the operator is asked once for each.

#include <algorithm>
#include <iterator>
#include <map>
#include <set>
#include <utility>

#include "protocol/base/file_writer.h"
#include "protocol/plan/emitter.h"
#include "protocol/plan/lower_bound.h"
#include "protocol/plan/needs.h"
#include "protocol/plan/order.h"
#include "protocol/plan/plan_source.h"
#include "protocol/plan/stations.h"
#include "protocol/plan/timing.h"
#include "protocol/rig/rig_geometry.h"

namespace mesorig {
namespace {

constexpr char kCapsOn[] = "Put the caps on all lenses. Then close the door and press reset.";
constexpr char kCapsOff[] = "Take the caps off all lenses. Then close the door and press reset.";
constexpr char kDiffuserIn[] =
    "Put the white diffuser in the sample's place. Then close the door and press reset.";
constexpr char kSampleBack[] =
    "Put the sample \"{}\" back in its place. Then close the door and press reset.";

// One compilation. Borrows rig and source.
class Compiler {
 public:
  Compiler(const Rig& rig, const PlanSource& source, const Needs& needs)
      : rig_(rig), source_(source), needs_(needs), emitter_(rig, plan_) {}

  StatusOr<CompiledPlan> Compile() {
    FillHeader();
    for (const DirectionSet& set : source_.sets) {
      MESORIG_ASSIGN_OR_RETURN(LitSet lit,
                               LightStations(rig_, set, needs_, source_.product.h_ref_mm));
      plan_.frames_blocked += lit.frames_blocked;
      plan_.frames_unneeded += lit.frames_unneeded;
      lit_sets_.push_back(std::move(lit));
    }
    MESORIG_RETURN_IF_ERROR(EmitPrompts(true));
    MESORIG_RETURN_IF_ERROR(EmitCalibrations());
    EmitSets();
    MESORIG_RETURN_IF_ERROR(EmitSweeps());
    MESORIG_RETURN_IF_ERROR(EmitPrompts(false));
    emitter_.Finish();
    const LowerBound bound = LowerBoundOf(plan_, rig_);
    plan_.lower_bound_s = bound.seconds;
    plan_.bottleneck = bound.resource;
    return std::move(plan_);
  }

 private:
  void FillHeader() {
    plan_.name = source_.name;
    plan_.sample_name = source_.sample.name;
    plan_.sample_notes = source_.sample.notes;
    plan_.sample_extent_mm = source_.sample.extent_mm;
    plan_.sample_thickness_mm = source_.sample.thickness_mm;
    plan_.sample_sha256 = Sha256OfSample(source_.sample);
    plan_.rig_sha256 = rig_.sha256;
    plan_.product = source_.product;
    plan_.homing_s = HomingSeconds(rig_);
  }

  Status EmitPrompts(bool before) {
    for (const OperatorPrompt& prompt : source_.prompts) {
      if (prompt.before == before) MESORIG_RETURN_IF_ERROR(emitter_.Prompt(prompt.text));
    }
    return OkStatus();
  }

  // Exposures of the plan with the cameras that get them; under lamps: of grids and lists only.
  using CamerasOf = std::map<double, std::set<int>>;
  CamerasOf ExposuresOfPlan(bool under_lamps) const {
    CamerasOf cameras_of;
    const auto add = [&](double exposure_s, const std::vector<int>& cameras) {
      cameras_of[exposure_s].insert(cameras.begin(), cameras.end());
    };
    for (const DirectionSet& set : source_.sets) {
      for (const double e : set.exposures.possible_s()) {
        add(e, set.cameras);
        for (const Station& station : set.stations) add(e, station.cameras);
      }
    }
    for (const SweepGrid& sweep : source_.sweeps) {
      if (!under_lamps) add(sweep.exposure_s, sweep.cameras);
    }
    return cameras_of;
  }

  std::vector<int> LampsOfPlan() const {
    std::set<int> lamps;
    for (const LitSet& set : lit_sets_) {
      for (const LitStation& station : set.stations) {
        for (const LitStation::Lit& lit : station.lit) lamps.insert(lit.lamp);
      }
    }
    return {lamps.begin(), lamps.end()};
  }

  // Where calibration frames are taken: the first station of the plan, or home.
  std::vector<double> FirstPosition() const {
    for (const LitSet& set : lit_sets_) {
      for (const LitStation& station : set.stations) {
        if (!station.lit.empty()) return station.axis_rad;
      }
    }
    if (!source_.sweeps.empty()) return Combinations(source_.sweeps[0].axis_rad)[0];
    return std::vector<double>(rig_.axes.size(), 0.0);
  }

  Status EmitCalibrations() {
    for (const Purpose purpose : {Purpose::kDark, Purpose::kFlat, Purpose::kAmbient}) {
      std::vector<const Calibration*> of_kind;
      for (const Calibration& calibration : source_.calibrations) {
        if (calibration.purpose == purpose) of_kind.push_back(&calibration);
      }
      if (of_kind.empty()) continue;
      if (purpose == Purpose::kDark) MESORIG_RETURN_IF_ERROR(emitter_.Prompt(kCapsOn));
      if (purpose == Purpose::kFlat) MESORIG_RETURN_IF_ERROR(emitter_.Prompt(kDiffuserIn));
      emitter_.Stand(FirstPosition(), 0);
      for (const Calibration* calibration : of_kind) {
        MESORIG_RETURN_IF_ERROR(EmitCalibration(*calibration));
      }
      if (purpose == Purpose::kDark) MESORIG_RETURN_IF_ERROR(emitter_.Prompt(kCapsOff));
      if (purpose == Purpose::kFlat) {
        MESORIG_RETURN_IF_ERROR(emitter_.Prompt(fmt::format(kSampleBack, source_.sample.name)));
      }
    }
    return OkStatus();
  }

  Status EmitCalibration(const Calibration& calibration) {
    const bool flat = calibration.purpose == Purpose::kFlat;
    CamerasOf cameras_of;
    for (const double e : calibration.exposures_s) {
      cameras_of[e].insert(calibration.cameras.begin(), calibration.cameras.end());
    }
    if (cameras_of.empty()) cameras_of = ExposuresOfPlan(flat);
    std::vector<int> lamps{-1};
    if (flat) lamps = calibration.lamps.empty() ? LampsOfPlan() : calibration.lamps;
    const uint32_t before = plan_.frames;
    for (const int lamp : lamps) {
      emitter_.Light(lamp);
      for (const auto& [exposure_s, used] : cameras_of) {
        std::vector<int> cameras;
        std::set_intersection(calibration.cameras.begin(), calibration.cameras.end(), used.begin(),
                              used.end(), std::back_inserter(cameras));
        for (uint32_t r = 0; r < calibration.repeats && !cameras.empty(); ++r) {
          emitter_.Shoot({cameras, exposure_s, calibration.purpose, -1});
        }
      }
    }
    if (plan_.frames > before) return OkStatus();
    return InvalidArgument(
        "{}: no frames: the plan has no exposures of these cameras{}; say "
        "exposures_s{}",
        calibration.where, flat ? " under lamps" : "", flat ? " and lamps" : "");
  }

  // One meter a lamp, at the first station that it lights.
  std::map<int, int> EmitMeters(const DirectionSet& set, const LitSet& lit_set) {
    std::map<int, int> meter_of_lamp;
    for (const LitStation& station : lit_set.stations) {
      for (const LitStation::Lit& lit : station.lit) {
        if (meter_of_lamp.contains(lit.lamp)) continue;
        emitter_.Stand(station.axis_rad, set.settle_s);
        emitter_.Light(lit.lamp);
        meter_of_lamp[lit.lamp] = emitter_.Meter(lit.cameras, set.exposures.ladder_s);
      }
    }
    return meter_of_lamp;
  }

  void EmitSets() {
    std::vector<std::map<int, int>> meters(source_.sets.size());
    for (size_t i = 0; i < source_.sets.size(); ++i) {
      if (source_.sets[i].exposures.metered()) {
        meters[i] = EmitMeters(source_.sets[i], lit_sets_[i]);
      }
    }
    for (size_t i = 0; i < source_.sets.size(); ++i) {
      const DirectionSet& set = source_.sets[i];
      const std::vector<LitStation>& stations = lit_sets_[i].stations;
      const std::vector<Visit> visits =
          set.is_grid
              ? OrderGrid(rig_, set.axis_rad, stations, set.lamps, set.settle_s, emitter_.at())
              : OrderList(rig_, stations, set.settle_s, emitter_.at());
      for (const Visit& visit : visits)
        EmitVisit(set, stations[visit.station], visit.lamp, meters[i]);
    }
  }

  void EmitVisit(const DirectionSet& set, const LitStation& station, int lamp,
                 const std::map<int, int>& meter_of_lamp) {
    const auto lit = std::find_if(station.lit.begin(), station.lit.end(),
                                  [&](const auto& l) { return l.lamp == lamp; });
    emitter_.Stand(station.axis_rad, set.settle_s);
    emitter_.Light(lamp);
    const bool metered = set.exposures.metered();
    const std::vector<double> exposures_s =
        metered ? std::vector{set.exposures.ladder_s.back()} : set.exposures.bracket_s;
    for (const double exposure_s : exposures_s) {
      for (uint32_t r = 0; r < set.repeats; ++r) {
        emitter_.Shoot(
            {lit->cameras, exposure_s, Purpose::kData, metered ? meter_of_lamp.at(lamp) : -1});
      }
    }
  }

  Status EmitSweeps() {
    emitter_.Light(-1);
    std::vector<uint32_t> frames(source_.sweeps.size(), 0);
    const int mounts = rig_.laser ? static_cast<int>(rig_.laser->mounts.size()) : 0;
    for (int mount = 0; mount < mounts; ++mount) {
      bool asked = false;
      for (size_t i = 0; i < source_.sweeps.size(); ++i) {
        const SweepGrid& sweep = source_.sweeps[i];
        if (!std::binary_search(sweep.mounts.begin(), sweep.mounts.end(), mount)) continue;
        const auto positions = Combinations(sweep.axis_rad);
        for (const size_t p : OrderStations(rig_, sweep.axis_rad, sweep.settle_s, emitter_.at())) {
          frames[i] += EmitSweep(sweep, mount, positions[p], asked);
        }
      }
    }
    for (size_t i = 0; i < frames.size(); ++i) {
      if (frames[i] > 0) continue;
      return InvalidArgument(
          "{}: solids of the rig block the laser or every camera at all positions",
          source_.sweeps[i].where);
    }
    return OkStatus();
  }

  // Of these cameras, those whose view the sample needs.
  std::vector<int> NeededCameras(const std::vector<int>& cameras,
                                 const std::vector<double>& axis_rad) const {
    const NeededPairs pairs(needs_);
    std::vector<int> needed;
    for (const int c : cameras) {
      const Vec3 p = SampleFromCamera(rig_, c, axis_rad).translation;
      if (pairs.WithinTheta(p - Vec3{0, 0, source_.product.h_ref_mm})) needed.push_back(c);
    }
    return needed;
  }

  uint32_t EmitSweep(const SweepGrid& grid, int mount, const std::vector<double>& axis_rad,
                     bool& asked) {
    std::vector<int> cameras = UnblockedCameras(rig_, grid.cameras, axis_rad);
    if (BlockedBy(rig_, LaserInWorld(rig_, mount, axis_rad).source, axis_rad)) cameras.clear();
    Sweep sweep;
    std::vector<int> seeing;
    for (const int c : cameras) {
      const auto region =
          RegionOfDisc(rig_, c, axis_rad, grid.region_radius_mm, source_.product.h_ref_mm);
      if (region) seeing.push_back(c);
    }
    const auto frames_of = [&](size_t count) { return grid.frames * static_cast<uint32_t>(count); };
    plan_.frames_blocked += frames_of(grid.cameras.size() - seeing.size());
    const std::vector<int> needed = NeededCameras(seeing, axis_rad);
    plan_.frames_unneeded += frames_of(seeing.size() - needed.size());
    if (needed.empty()) return frames_of(seeing.size());
    for (const int c : needed) {
      sweep.regions.push_back(
          *RegionOfDisc(rig_, c, axis_rad, grid.region_radius_mm, source_.product.h_ref_mm));
    }
    sweep.mount = mount;
    sweep.tilt_from_rad = TiltOfStripe(rig_.laser->mounts[mount], grid.from_mm);
    sweep.tilt_to_rad = TiltOfStripe(rig_.laser->mounts[mount], grid.to_mm);
    sweep.frames = grid.frames;
    sweep.frame_rate_hz = grid.frame_rate_hz;
    sweep.keep_frames = grid.keep_frames;
    if (!std::exchange(asked, true)) emitter_.Mount(mount);
    emitter_.Light(-1);
    emitter_.Stand(axis_rad, grid.settle_s);
    emitter_.RunSweep(needed, grid.exposure_s, std::move(sweep));
    return frames_of(seeing.size());
  }

  const Rig& rig_;
  const PlanSource& source_;
  const Needs needs_;
  CompiledPlan plan_;
  Emitter emitter_;
  std::vector<LitSet> lit_sets_;
};

}  // namespace

StatusOr<CompiledPlan> CompilePlan(std::string_view text, std::string_view name, const Rig& rig) {
  MESORIG_ASSIGN_OR_RETURN(const PlanSource source, ReadPlan(text, name, rig));
  MESORIG_ASSIGN_OR_RETURN(CompiledPlan plan, Compiler(rig, source, source.needs).Compile());
  if (!source.needs.all()) {
    MESORIG_ASSIGN_OR_RETURN(const CompiledPlan whole, Compiler(rig, source, Needs{}).Compile());
    plan.seconds_saved = std::max(0.0, whole.seconds - plan.seconds);
  }
  if (plan.frames == 0) {
    return InvalidArgument(
        "{}: no frame is left: {} are blocked by solids of the rig, {} not needed "
        "by the sample",
        name, plan.frames_blocked, plan.frames_unneeded);
  }
  return plan;
}

StatusOr<CompiledPlan> CompilePlanFile(const std::filesystem::path& path, const Rig& rig) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, 4u << 20));
  return CompilePlan(text, path.string(), rig);
}

}  // namespace mesorig
