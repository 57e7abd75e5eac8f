#pragma once
// A small rig for device tests.

#include "protocol/rig/rig.h"

namespace mesorig::simulator {

inline Rig SmallRig() {
  constexpr std::string_view kText = R"(
name = "small"
sample_radius_mm = 20
[[axis]]
name = "turntable"
can_node = 5
counts_per_turn = 36000
min_deg = -180
max_deg = 180
max_velocity_deg_s = 90
acceleration_deg_s2 = 180
homing_velocity_deg_s = 20
[[frame]]
name = "sample"
axis = "turntable"
[[lamp]]
name = "L0"
distance_mm = 600
theta_deg = 30
channel = 0
intensity_w_sr = [10, 10, 10]
rise_s = 0.05
settle_s = 0.5
[[lamp]]
name = "L1"
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
[lamp_bank]
unit = 1
timeout_s = 2
[lines]
estop = 0
door = 1
reset = 2
)";
  return ParseRig(kText, "small.toml").value();
}

}  // namespace mesorig::simulator
