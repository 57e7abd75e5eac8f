#pragma once
// The description of a rig, as read from a TOML file (rigs/*.toml).
//
// World frame: origin at the turntable centre on its plane, z up, right-handed, mm. Poses are
// kinematic chains: a frame hangs on its parent by a fixed translation and, optionally, turns with
// a named axis. Lamps, cameras and solids stand in frames. The frame named "sample" carries the
// sample; its origin is the centre of the crop. Values here are immutable after loading; all
// functions are reentrant.

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"
#include "protocol/base/toml_reader.h"
#include "protocol/rig/buses.h"

namespace mesorig {

// A rotary axis behind a CiA 402 node.
struct Axis {
  std::string name;
  int can_node = 0;                 // 1..127
  double counts_per_turn = 0;       // encoder counts, position unit on the wire
  double min_rad = 0, max_rad = 0;  // soft limits: cable wrap
  double max_velocity_rad_s = 0;
  double acceleration_rad_s2 = 0;
  double homing_velocity_rad_s = 0;
  double settle_s = 0;  // vibration after each of its moves dies down in this time
  // Homing again finds the reference this near to where the count says it is, or steps were lost.
  double reference_tolerance_rad = 0;
};

struct Frame {
  std::string name;
  int parent = -1;               // index into Rig::frames; -1 is the world
  Vec3 translation_mm;           // origin of this frame in its parent
  int axis = -1;                 // index into Rig::axes; -1: fixed
  Vec3 axis_direction{0, 0, 1};  // unit vector in the parent: turns counter-clockwise about it
};

// A point lamp.
struct Lamp {
  std::string name;
  int frame = -1;
  Vec3 p_in_frame;                         // mm
  int channel = 0;                         // of the lamp bank
  std::array<double, 3> intensity_w_sr{};  // radiant intensity at full level: red, green, blue
  double rise_s = 0;                       // filament time constant
  double settle_s = 0;                     // from command to steady light
};

enum class BayerPattern { kMono, kRggb };

// A rectangle of pixels of a sensor: what a camera reads. Even origin and size, so that the Bayer
// pattern stays.
struct Region {
  int x = 0, y = 0, width = 0, height = 0;
  friend bool operator==(const Region&, const Region&) = default;
};

// A pinhole camera. Camera frame: x right, y down, z forward. A point (x, y, z) of it is seen at
// u = focal_px x/z + cx, v = focal_px y/z + cy; pixel (i, j) covers [i, i+1) x [j, j+1), so that
// its centre is (i + 1/2, j + 1/2).
struct Camera {
  std::string name, serial;
  int frame = -1;
  RigidTransform frame_from_camera;
  int width = 0, height = 0;
  double focal_px = 0, cx = 0, cy = 0;
  BayerPattern pattern = BayerPattern::kMono;
  int bits = 12;                        // 8 or 12; 12 bits travel in two bytes, little-endian
  int black_dn = 0;                     // code value without light
  double full_well_e = 0;               // electrons at the largest code value (gain 1)
  double read_noise_e = 0;              // standard deviation, electrons
  double electrons_per_radiance_s = 0;  // per W m^-2 sr^-1 and second, every channel
  double min_exposure_s = 0, max_exposure_s = 0;
  double readout_s = 0;  // from the end of exposure to the frame's delivery
  double trigger_latency_s = 1e-3;  // from the trigger to the start of exposure, at most
  int white_dn() const { return (1 << bits) - 1; }
  int bytes_per_pixel() const { return bits > 8 ? 2 : 1; }
  Region full_region() const { return {0, 0, width, height}; }
  size_t frame_bytes() const {
    return static_cast<size_t>(width) * static_cast<size_t>(height) *
           static_cast<size_t>(bytes_per_pixel());
  }
};

// A capsule that blocks beams and views.
struct Solid {
  std::string name;
  int frame = -1;
  Vec3 a_in_frame, b_in_frame;  // mm
  double radius_mm = 0;
};

// The disc that the sample lies on: z = 0 of the frame "sample", seen where the sample is not.
struct Turntable {
  double radius_mm = 0;
  double albedo = 0;  // diffuse, of every colour
};

// A place where the laser unit can be mounted by hand: on the laser's frame at azimuth 0.
struct LaserMount {
  std::string name;
  double theta_rad = 0;    // polar angle from the frame's +z
  double distance_mm = 0;  // from the frame's origin to the emitter
};

// A line laser whose emitter is tilted by a geared motor (docs/laser.md holds the geometry). At
// tilt 0 the sheet passes through the frame's origin.
struct Laser {
  std::string name;
  int frame = -1;
  std::vector<LaserMount> mounts;    // at least one
  int motor_port = 0;                // of the NXT brick: 0 is A
  double gear_ratio = 1;             // turns of the motor for one turn of the emitter
  double backlash_rad = 0;           // of the motor, at most
  double full_speed_rad_s = 0;       // of the motor, regulated, at power 100
  double max_tilt_rad = 0;           // to both sides
  double fan_rad = 0;                // full opening of the sheet
  double fwhm_mm = 0;                // thickness of the sheet, full width at half maximum
  double power_w = 0;                // spread evenly over the fan
  std::array<double, 3> response{};  // of red, green and blue pixels to its light, 0..1
};

// The lamp bank: Modbus coils switch, input registers read back (0..1000 per mille of full flux).
struct LampBank {
  int unit = 1;          // Modbus unit id
  double timeout_s = 0;  // communication-loss timeout: all lamps off
  // The bank measures the temperature of every lamp's housing (input registers after those of the
  // flux, tenths of a degree).
  bool housing_temperatures = false;
  double max_housing_c = 0;  // of those; 0: no limit
  double rated_hours = 0;  // of a bulb; 0: not told
};

// Digital lines by number. Inputs are normally closed: level 1 is closed (good), 0 open. A rig
// with a laser has two more: each rising edge of `laser_trigger` (output) holds the laser on for
// kLaserOneShot_s, so that a steady level is off; `laser_on` (input) reads 1 while it shines.
// `power` reads 1 while the contactor is closed. A rig without `interlock` has none of the first
// three: its chain counts as closed, and no plan with a laser runs on it.
struct Lines {
  int estop = 0, door = 1, reset = 2;
  int laser_trigger = -1, laser_on = -1;
  int power = -1;  // -1: it cannot be read back
  bool interlock = true;
};
inline constexpr double kLaserOneShot_s = 0.25;

struct Rig {
  std::string name;
  std::vector<Axis> axes;
  std::vector<Frame> frames;
  std::vector<Lamp> lamps;
  std::vector<Camera> cameras;
  std::vector<Solid> solids;
  std::optional<Laser> laser;
  std::optional<Turntable> turntable;  // a rig with a laser has one
  LampBank lamp_bank;
  Lines lines;
  Buses buses;
  double heartbeat_s = 0.5;     // CANopen heartbeat of every node and of the daemon
  double mains_hz = 0;          // lamps flicker at twice this; 0: they do not
  double sample_radius_mm = 0;  // beams and views are checked against solids over this disc
  std::string source_text;      // the TOML it was read from
  std::string sha256;           // of source_text

  std::optional<int> FindAxis(std::string_view axis_name) const;
  std::optional<int> FindFrame(std::string_view frame_name) const;
  std::optional<int> FindLamp(std::string_view lamp_name) const;
  std::optional<int> FindCamera(std::string_view camera_name) const;
  std::optional<int> FindMount(std::string_view mount_name) const;  // of the laser
};

// NotFound or InvalidArgument with file:line:column: syntax, unknown key, value out of range, a
// name that is used twice or not defined, two lamps on one channel, two axes on one node, a laser
// without its lines, a bus at two places.
StatusOr<Rig> LoadRig(const std::filesystem::path& path);
StatusOr<Rig> ParseRig(std::string_view text, std::string_view name);

}  // namespace mesorig
