#pragma once
// Internal to protocol/plan: what a plan file says, read and checked against the rig, before any
// order is made of it. docs/plans.md tells the keys.

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/plan/plan.h"
#include "protocol/rig/rig.h"

namespace mesorig {

// What of its directions the sample does not need.
enum class Symmetry { kNone, kHalfTurn, kQuarterTurn, kIsotropic };
struct Needs {
  Symmetry symmetry = Symmetry::kNone;
  double max_theta_rad = 0;  // of views and lights; 0: no limit
  bool all() const { return symmetry == Symmetry::kNone && max_theta_rad == 0; }
};

// Of a grid or a list: a bracket (one shot each, ascending), or metered.
struct Exposures {
  std::vector<double> bracket_s;  // empty: metered
  std::vector<double> ladder_s;   // metered: what to choose from, ascending
  bool metered() const { return bracket_s.empty(); }
  // The exposures that cameras may get.
  const std::vector<double>& possible_s() const { return metered() ? ladder_s : bracket_s; }
};

// How the axes stand, and what is taken there: every lamp with every camera.
struct Station {
  std::vector<double> axis_rad;  // one per Rig::axes
  std::vector<int> lamps, cameras;
  std::string where;  // file:line:column, of a list's position
};

// A [[grid]] (the product of axis_rad, with lamps and cameras) or a [[list]] (its stations).
struct DirectionSet {
  std::string where;
  bool is_grid = true;
  std::vector<std::vector<double>> axis_rad;  // grid: one ascending list per Rig::axes
  std::vector<int> lamps, cameras;            // grid
  std::vector<Station> stations;              // list
  Exposures exposures;
  uint32_t repeats = 1;
  double settle_s = 0;
};

// A [[sweep]]: every combination of mounts and the axes' angles.
struct SweepGrid {
  std::string where;
  std::vector<std::vector<double>> axis_rad;  // as of a grid
  std::vector<int> mounts, cameras;
  double exposure_s = 0, frame_rate_hz = 0, from_mm = 0, to_mm = 0, region_radius_mm = 0;
  double settle_s = 0;
  uint32_t frames = 0;
  bool keep_frames = true;
};

struct Calibration {
  std::string where;
  Purpose purpose = Purpose::kDark;
  std::vector<double> exposures_s;  // empty: all that the plan uses
  std::vector<int> lamps;           // flats only; empty: all that the plan uses
  std::vector<int> cameras;
  uint32_t repeats = 1;
};

struct OperatorPrompt {
  std::string text;
  bool before = true;  // everything else; otherwise after
};

struct PlanSource {
  std::string name;
  SampleRecord sample;
  Needs needs;
  Product product;
  std::vector<DirectionSet> sets;
  std::vector<SweepGrid> sweeps;
  std::vector<Calibration> calibrations;
  std::vector<OperatorPrompt> prompts;
};

// InvalidArgument with file:line:column, as CompilePlan.
StatusOr<PlanSource> ReadPlan(std::string_view text, std::string_view name, const Rig& rig);

// The tilt whose stripe crosses the turntable at x (docs/laser.md).
double TiltOfStripe(const LaserMount& mount, double x_mm);

}  // namespace mesorig
