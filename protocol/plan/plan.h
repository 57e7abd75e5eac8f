#pragma once
// A compiled plan: the steps that the sequencer runs, and what they will take. Compiled once,
// stored as `plan.bin` with its SHA-256; what runs is exactly what was checked.

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/rig/rig.h"

namespace mesorig {

// What the session produces: the crop is centred on the sample frame's origin.
struct Product {
  int width_px = 0, height_px = 0;
  double pitch_mm = 0;
  double h_ref_mm = 0;  // reference plane, above the top of the mesostructure
};

// Moves and lamps say how the rig must stand for the shots that follow; a shot, a metering or a
// sweep begins when it does (docs/running.md, "One shot after the other").
enum class StepKind : uint8_t {
  kMoveAxes = 1,  // all axes at axis_rad, and settle_s at rest
  kLamp = 2,      // `lamp` alone (-1: all off), its light steady
  kShot = 3,      // one trigger of `cameras`, all with exposure_s
  kMount = 4,     // the operator mounts the laser at `sweep.mount`; everything is off meanwhile
  kSweep = 5,     // the laser sweeps; `cameras` are triggered sweep.frames times with exposure_s
  kPrompt = 6,    // the operator does `text`; everything is off meanwhile
  kMeter = 7,     // chooses the exposure of the shots with this `meter` from ladder_s
};

// What a shot is for.
enum class Purpose : uint8_t {
  kData = 0,     // the sample under one lamp, or a sweep
  kAmbient = 1,  // all lamps off: what light leaks in
  kDark = 2,     // all lamps off, lenses capped (a kPrompt stands before)
  kFlat = 3,     // a white diffuser in the sample's place, under one lamp (a kPrompt stands before)
};

// One sweep of the laser (docs/laser.md). Each of its triggers is a shot of its own.
struct Sweep {
  uint32_t index = 0;                         // 0-based, in order of running
  int mount = -1;                             // index into Laser::mounts
  double tilt_from_rad = 0, tilt_to_rad = 0;  // at the first and the last frame
  uint32_t frames = 0;                        // triggers
  double frame_rate_hz = 0;
  bool keep_frames = true;      // false: raw frames go when their displacements are durable
  std::vector<Region> regions;  // one per Step::cameras
};

struct Step {
  StepKind kind{};
  std::vector<double> axis_rad;  // kMoveAxes: one per Rig::axes
  int lamp = -1;                 // kLamp
  uint32_t shot = 0;             // kShot: 0-based, in order of running; kSweep: of its first frame
  double exposure_s = 0;         // kShot, kSweep; of a metered shot the longest of its ladder
  std::vector<int> cameras;      // kShot, kSweep, kMeter: indices into Rig::cameras, ascending
  Sweep sweep;                   // kSweep; kMount: its mount
  Purpose purpose = Purpose::kData;  // kShot
  uint32_t repeat = 0;               // kShot: counts equal shots from 0; the cameras' repeat index
  double settle_s = 0;               // kMoveAxes: vibration dies down after the last axis arrived
  int meter = -1;                    // kMeter: its number; kShot: whose exposure it takes, -1: none
  std::vector<double> ladder_s;      // kMeter: exposures to choose from, ascending
  std::string text;                  // kPrompt: what the operator is asked to do
};

// What is measured, as the person who puts it there describes it.
struct SampleRecord {
  std::string name, notes;
  double thickness_mm = 0;  // 0: not said
  double extent_mm = 0;     // side of its square footprint, centred; 0: not said
};

struct CompiledPlan {
  std::string name, sample_name;
  std::string rig_sha256;
  std::string sample_sha256;    // of the whole record, Sha256OfSample
  double sample_extent_mm = 0;  // as SampleRecord
  double sample_thickness_mm = 0;
  std::string sample_notes;
  Product product;
  std::vector<Step> steps;
  // Totals.
  uint32_t shots = 0, frames = 0, sweeps = 0;
  uint32_t prompts = 0;      // kMount and kPrompt
  uint64_t frame_bytes = 0;  // pixels of all frames
  double seconds = 0;        // estimate in rig time; homing and the operator's time are not in it
  double homing_s = 0;       // estimate of homing, from home; farther away takes longer
  double lamp_seconds = 0;
  double lower_bound_s = 0;     // no order of these shots and sweeps is faster: docs/plans.md
  std::string bottleneck;       // the resource that tells it: "exposure", "axis ...", "camera ..."
  uint32_t frames_blocked = 0;  // left out: a solid stands in the camera's view or the light's beam
  uint32_t frames_unneeded = 0;  // left out: the sample does not need them, as its record says
  double seconds_saved = 0;      // by leaving those out
};

// Reads a plan file and compiles it for this rig; docs/plans.md tells its keys. NotFound or
// InvalidArgument with file:line:column: unknown keys, axis limits, cable wrap, unknown lamps and
// cameras, exposures that a camera cannot do or that are no whole half periods of the mains, sweeps
// beyond the laser's tilt, directions below the horizon or that everything blocks. Pure, reentrant.
StatusOr<CompiledPlan> CompilePlanFile(const std::filesystem::path& path, const Rig& rig);
StatusOr<CompiledPlan> CompilePlan(std::string_view text, std::string_view name, const Rig& rig);

// Of a canonical text of all its fields, hexadecimal.
std::string Sha256OfSample(const SampleRecord& sample);

// `plan.bin`: equal plans give equal bytes.
std::string PackPlan(const CompiledPlan& plan);
// InvalidArgument for bytes that are no plan, or with a step that the rig cannot do: numbers that
// are not finite or out of range, axes, lamps, cameras or mounts that it lacks, a shot whose meter
// no step before it declares. Another version too.
StatusOr<CompiledPlan> UnpackPlan(std::string_view bytes, const Rig& rig);

// Time of a trapezoidal (or triangular) move of `axis` over `distance_rad`, s.
double MoveSeconds(const Axis& axis, double distance_rad);

}  // namespace mesorig
