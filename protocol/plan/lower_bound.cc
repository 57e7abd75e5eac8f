#include "protocol/plan/lower_bound.h"

#include <algorithm>
#include <map>
#include <set>

#include "protocol/plan/timing.h"

namespace mesorig {
namespace {

// What a plan's steps ask for, without their order.
struct Demand {
  std::vector<std::set<double>> angles;                  // per axis, home included
  std::set<std::vector<double>> positions;               // where shots are taken
  std::set<std::pair<std::vector<double>, int>> states;  // with the lamp
  std::vector<double> readout_s;                         // per camera, all its frames
  double exposure_s = 0;                                 // all shots
  double least_readout_s = 1e300, least_settle_s = 1e300;
  uint32_t shots = 0, interruptions = 0;  // of shots: by prompts, sweeps, start
  std::vector<const Sweep*> sweeps;
};

void AddShot(const Rig& rig, const Step& step, double exposure_s, const std::vector<double>& at,
             int lamp, Demand& demand) {
  ++demand.shots;
  demand.exposure_s += exposure_s;
  demand.least_readout_s = std::min(demand.least_readout_s, ReadoutSeconds(rig, step.cameras));
  demand.positions.insert(at);
  demand.states.emplace(at, lamp);
  for (const int c : step.cameras) demand.readout_s[c] += rig.cameras[c].readout_s;
}

Demand DemandOf(const CompiledPlan& plan, const Rig& rig) {
  Demand demand;
  demand.angles.assign(rig.axes.size(), {0.0});
  demand.readout_s.assign(rig.cameras.size(), 0.0);
  demand.interruptions = 1;
  std::vector<double> at(rig.axes.size(), 0.0);
  int lamp = -1;
  for (const Step& step : plan.steps) {
    switch (step.kind) {
      case StepKind::kMoveAxes:
        at = step.axis_rad;
        for (size_t i = 0; i < at.size(); ++i) demand.angles[i].insert(at[i]);
        demand.least_settle_s = std::min(demand.least_settle_s, step.settle_s);
        break;
      case StepKind::kLamp:
        lamp = step.lamp;
        break;
      case StepKind::kShot:
        AddShot(rig, step, step.exposure_s, at, lamp, demand);
        break;
      case StepKind::kMeter:
        for (const double e : step.ladder_s) AddShot(rig, step, e, at, lamp, demand);
        break;
      case StepKind::kSweep:
        demand.sweeps.push_back(&step.sweep);
        for (const int c : step.cameras) {
          demand.readout_s[c] += step.sweep.frames * rig.cameras[c].readout_s;
        }
        ++demand.interruptions;
        break;
      case StepKind::kMount:
      case StepKind::kPrompt:
        ++demand.interruptions;
        break;
    }
  }
  return demand;
}

// Visiting all angles is a spanning tree of them; the lightest joins neighbours, as a move takes
// the longer the farther it goes.
double AxisSeconds(const Axis& axis, const std::set<double>& angles, double least_settle_s) {
  double seconds = 0;
  for (auto it = std::next(angles.begin()); it != angles.end(); ++it) {
    seconds += MoveSeconds(axis, *it - *std::prev(it)) + std::max(axis.settle_s, least_settle_s);
  }
  return seconds;
}

// Two positions differ in one axis at least, by the least gap between its angles at least.
double LeastMoveSeconds(const Rig& rig, const Demand& demand) {
  double least = 1e300;
  for (size_t i = 0; i < rig.axes.size(); ++i) {
    const auto& angles = demand.angles[i];
    for (auto it = std::next(angles.begin()); it != angles.end(); ++it) {
      least = std::min(least, MoveSeconds(rig.axes[i], *it - *std::prev(it)) +
                                  std::max(rig.axes[i].settle_s, demand.least_settle_s));
    }
  }
  return least < 1e300 ? least : 0;
}

// Every exposure, and before it the least that can have happened since the one before.
double ShotSeconds(const Rig& rig, const Demand& demand) {
  if (demand.shots == 0) return 0;
  const double readout = demand.least_readout_s;
  const double move = std::max(LeastMoveSeconds(rig, demand), readout);
  const double lamp = std::min(move, std::max(LampSeconds(rig), readout));
  const auto positions = static_cast<double>(demand.positions.size());
  const auto states = static_cast<double>(demand.states.size());
  const double between =
      (positions - 1) * move + (states - positions) * lamp + (demand.shots - states) * readout;
  return demand.exposure_s + std::max(0.0, between - demand.interruptions * readout);
}

// The sweeps of one mount: each, and before it the emitter's way to its start; of one from upright,
// where the mount left it, of the others from where the nearest of them all ends.
double MountSeconds(const Laser& laser, const std::vector<const Sweep*>& sweeps) {
  std::set<double> ends;
  for (const Sweep* sweep : sweeps) ends.insert(SweepSeconds(laser, *sweep, 0).end_tilt_rad);
  double seconds = 0, most_saved = 0;
  for (const Sweep* sweep : sweeps) {
    const SweepTime upright = SweepSeconds(laser, *sweep, 0);
    double prepare = 1e300;
    for (const double end : ends) {
      prepare = std::min(prepare, SweepSeconds(laser, *sweep, end).prepare_s);
    }
    seconds += prepare + upright.run_s;
    most_saved = std::max(most_saved, prepare - upright.prepare_s);
  }
  return seconds - most_saved;
}

double LaserSeconds(const Rig& rig, const Demand& demand) {
  std::map<int, std::vector<const Sweep*>> sweeps_of_mount;
  for (const Sweep* sweep : demand.sweeps) sweeps_of_mount[sweep->mount].push_back(sweep);
  double seconds = 0;
  for (const auto& [mount, sweeps] : sweeps_of_mount) seconds += MountSeconds(*rig.laser, sweeps);
  return seconds;
}

}  // namespace

LowerBound LowerBoundOf(const CompiledPlan& plan, const Rig& rig) {
  const Demand demand = DemandOf(plan, rig);
  LowerBound bound;
  const auto consider = [&](double seconds, const std::string& resource) {
    if (seconds > bound.seconds) bound = {seconds, resource};
  };
  const double laser = LaserSeconds(rig, demand);
  consider(laser, "laser");
  consider(laser + ShotSeconds(rig, demand), "exposure");
  const double settle = demand.least_settle_s < 1e300 ? demand.least_settle_s : 0;
  for (size_t i = 0; i < rig.axes.size(); ++i) {
    consider(AxisSeconds(rig.axes[i], demand.angles[i], settle), "axis " + rig.axes[i].name);
  }
  for (size_t c = 0; c < rig.cameras.size(); ++c) {
    consider(demand.readout_s[c], "transfer of camera " + rig.cameras[c].name);
  }
  return bound;
}

}  // namespace mesorig
