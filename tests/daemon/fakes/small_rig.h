#pragma once
// Two axes, two lamps, two cameras.

#include "protocol/plan/plan.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

inline Rig SmallRig() {
  constexpr std::string_view kText = R"(
name = "small"
sample_radius_mm = 20
heartbeat_s = 0.5
[[axis]]
name = "turntable"
can_node = 5
counts_per_turn = 36000
min_deg = -180
max_deg = 180
max_velocity_deg_s = 90
acceleration_deg_s2 = 180
homing_velocity_deg_s = 20
[[axis]]
name = "arc"
can_node = 6
counts_per_turn = 72000
min_deg = -90
max_deg = 90
max_velocity_deg_s = 30
acceleration_deg_s2 = 60
homing_velocity_deg_s = 10
[[frame]]
name = "sample"
axis = "turntable"
[[frame]]
name = "light_arc"
axis = "arc"
[[lamp]]
name = "L0"
frame = "light_arc"
distance_mm = 600
theta_deg = 30
channel = 0
intensity_w_sr = [10, 10, 10]
rise_s = 0.05
settle_s = 0.5
[[lamp]]
name = "L1"
frame = "light_arc"
distance_mm = 600
theta_deg = 50
channel = 2
intensity_w_sr = [10, 10, 10]
rise_s = 0.05
settle_s = 0.5
[[camera]]
name = "C0"
serial = "1000"
distance_mm = 800
theta_deg = 20
width_px = 16
height_px = 8
focal_px = 100
pattern = "RGGB"
bits = 12
black_dn = 64
full_well_e = 10000
read_noise_e = 5
electrons_per_radiance_s = 1e6
min_exposure_s = 0.001
max_exposure_s = 1
readout_s = 0.01
[[camera]]
name = "C1"
serial = "1001"
distance_mm = 800
theta_deg = 40
width_px = 16
height_px = 8
focal_px = 100
pattern = "RGGB"
bits = 12
black_dn = 64
full_well_e = 10000
read_noise_e = 5
electrons_per_radiance_s = 1e6
min_exposure_s = 0.001
max_exposure_s = 1
readout_s = 0.03
[lamp_bank]
unit = 1
timeout_s = 1
[lines]
estop = 0
door = 1
reset = 2
)";
  return ParseRig(kText, "small.toml").value();
}

// The small rig with a laser of two mounts on the arc.
inline Rig SmallLaserRig() {
  constexpr std::string_view kLaser = R"(
laser_trigger = 3
laser_on = 4
[turntable]
radius_mm = 60
albedo = 0.3
[laser]
name = "line_laser"
frame = "light_arc"
motor_port = 0
gear_ratio = 240
backlash_deg = 30
full_speed_deg_s = 900
max_tilt_deg = 6
fan_deg = 60
fwhm_mm = 2
power_w = 0.03
response = [0.15, 1, 0.1]
[[laser.mount]]
name = "high"
theta_deg = 10
distance_mm = 500
[[laser.mount]]
name = "low"
theta_deg = 40
distance_mm = 500
)";
  // (The lines are the last table of the small rig.)
  return ParseRig(SmallRig().source_text + std::string(kLaser), "small_laser.toml").value();
}

inline Step MountStep(int mount) {
  Step step;
  step.kind = StepKind::kMount;
  step.sweep.mount = mount;
  return step;
}
inline Step SweepStep(uint32_t index, uint32_t shot, int mount, uint32_t frames) {
  Step step;
  step.kind = StepKind::kSweep;
  step.shot = shot;
  step.exposure_s = 0.02;
  step.cameras = {0, 1};
  step.sweep = {index, mount, -0.05, 0.05, frames, 10, true, {{2, 2, 8, 4}, {0, 0, 16, 8}}};
  return step;
}

inline Step MoveStep(double turntable_deg, double arc_deg) {
  Step step;
  step.kind = StepKind::kMoveAxes;
  step.axis_rad = {RadFromDeg(turntable_deg), RadFromDeg(arc_deg)};
  return step;
}
inline Step LampStep(int lamp) {
  Step step;
  step.kind = StepKind::kLamp;
  step.lamp = lamp;
  return step;
}
inline Step ShotStep(uint32_t shot, double exposure_s, std::vector<int> cameras) {
  Step step;
  step.kind = StepKind::kShot;
  step.shot = shot;
  step.exposure_s = exposure_s;
  step.cameras = std::move(cameras);
  return step;
}

// Two positions, two lamps, three shots, five frames.
inline CompiledPlan SmallPlan(const Rig& rig) {
  CompiledPlan plan;
  plan.name = "small";
  plan.rig_sha256 = rig.sha256;
  plan.steps = {
      MoveStep(30, -20),         LampStep(0),      ShotStep(0, 0.02, {0, 1}), LampStep(1),
      ShotStep(1, 0.02, {0, 1}), MoveStep(60, 10), ShotStep(2, 0.04, {1}),    LampStep(-1)};
  plan.shots = 3;
  plan.frames = 5;
  plan.seconds = 5;
  return plan;
}

// One shot under a lamp, then two sweeps of five frames at one mount and one at the other.
inline CompiledPlan SmallLaserPlan(const Rig& rig) {
  CompiledPlan plan;
  plan.name = "sweeps";
  plan.rig_sha256 = rig.sha256;
  plan.sample_extent_mm = 20;
  plan.steps = {MoveStep(30, -20),     LampStep(0),           ShotStep(0, 0.02, {0, 1}),
                LampStep(-1),          MountStep(0),          SweepStep(0, 1, 0, 5),
                MoveStep(60, 10),      SweepStep(1, 6, 0, 5), MountStep(1),
                SweepStep(2, 11, 1, 5)};
  plan.shots = 16;
  plan.frames = 32;
  plan.sweeps = 3;
  plan.prompts = 2;
  plan.seconds = 10;
  return plan;
}

}  // namespace mesorig::daemon
