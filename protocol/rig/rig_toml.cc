// Reads a rig file. Directions of lamps and cameras are given as the rig builder measures them:
// distance from the frame's origin, polar angle from +z, azimuth from +x.

#include <algorithm>
#include <set>

#include "protocol/base/digest.h"
#include "protocol/base/file_writer.h"
#include "protocol/rig/rig.h"

namespace mesorig {
namespace {

// Refuses a name or number that was used before.
template <typename T>
class Unique {
 public:
  void Add(TomlTable& table, std::string_view key, const T& value) {
    if (!seen_.insert(value).second) table.Error(key, fmt::format("is `{}`, which is used twice", value));
  }

 private:
  std::set<T> seen_;
};

Axis ReadAxis(TomlTable t) {
  Axis axis;
  axis.name = t.String("name");
  axis.can_node = static_cast<int>(t.Integer("can_node", {1, 127}));
  axis.counts_per_turn = t.Number("counts_per_turn", {1, 1e8});
  axis.min_rad = RadFromDeg(t.Number("min_deg", {-3600, 3600}));
  axis.max_rad = RadFromDeg(t.Number("max_deg", {-3600, 3600}));
  if (!(axis.min_rad < axis.max_rad)) t.Error("max_deg", "must be above min_deg");
  axis.max_velocity_rad_s = RadFromDeg(t.Number("max_velocity_deg_s", {0.001, 3600}));
  axis.acceleration_rad_s2 = RadFromDeg(t.Number("acceleration_deg_s2", {0.001, 36000}));
  axis.homing_velocity_rad_s = RadFromDeg(t.Number("homing_velocity_deg_s", {0.001, 3600}));
  axis.settle_s = t.NumberOr("settle_s", 0, {0, 600});
  axis.reference_tolerance_rad = RadFromDeg(t.NumberOr("reference_tolerance_deg", 0.1, {0, 360}));
  return axis;
}

int ReadFrameName(TomlTable& t, const Rig& rig, std::string_view key) {
  const std::string name = t.StringOr(key, "world");
  if (name == "world") return -1;
  const auto frame = rig.FindFrame(name);
  if (!frame) t.Error(key, fmt::format("names the frame `{}`, which is not defined above", name));
  return frame.value_or(-1);
}

Frame ReadFrame(TomlTable t, const Rig& rig) {
  Frame frame;
  frame.name = t.String("name");
  if (frame.name == "world") t.Error("name", "`world` is the root and cannot be defined again");
  frame.parent = ReadFrameName(t, rig, "parent");
  frame.translation_mm = t.VectorOr("translation_mm", {}, {-1e5, 1e5});
  if (t.Has("axis")) {
    const std::string axis = t.String("axis");
    const auto index = rig.FindAxis(axis);
    if (!index) t.Error("axis", fmt::format("names `{}`, which is not an [[axis]]", axis));
    frame.axis = index.value_or(-1);
    frame.axis_direction = t.VectorOr("axis_direction", {0, 0, 1}, {-1, 1});
    if (std::abs(Norm(frame.axis_direction) - 1) > 1e-6) {
      t.Error("axis_direction", "must be a unit vector");
    }
    frame.axis_direction = Normalized(frame.axis_direction);
  }
  return frame;
}

Vec3 ReadPosition(TomlTable& t) {
  const double distance = t.Number("distance_mm", {1, 1e5});
  const double theta = RadFromDeg(t.Number("theta_deg", {0, 180}));
  const double phi = RadFromDeg(t.NumberOr("phi_deg", 0, {-360, 360}));
  return distance * DirectionFromAngles(theta, phi);
}

Lamp ReadLamp(TomlTable t, const Rig& rig) {
  Lamp lamp;
  lamp.name = t.String("name");
  lamp.frame = ReadFrameName(t, rig, "frame");
  lamp.p_in_frame = ReadPosition(t);
  lamp.channel = static_cast<int>(t.Integer("channel", {0, 255}));
  const Vec3 intensity = t.Vector("intensity_w_sr", {1e-9, 1e9});
  lamp.intensity_w_sr = {intensity.x, intensity.y, intensity.z};
  lamp.rise_s = t.Number("rise_s", {0, 100});
  lamp.settle_s = t.Number("settle_s", {0, 1000});
  return lamp;
}

Camera ReadCamera(TomlTable t, const Rig& rig) {
  Camera camera;
  camera.name = t.String("name");
  camera.serial = t.String("serial");
  camera.frame = ReadFrameName(t, rig, "frame");
  const double theta = RadFromDeg(t.Number("theta_deg", {0, 180}));
  const double phi = RadFromDeg(t.NumberOr("phi_deg", 0, {-360, 360}));
  // Looks at the frame's origin; image down is the direction of growing theta, which is defined at
  // the zenith too: columns of the rotation are e_phi, e_theta, -d.
  const Vec3 d = DirectionFromAngles(theta, phi);
  const Vec3 e_theta{std::cos(theta) * std::cos(phi), std::cos(theta) * std::sin(phi),
                     -std::sin(theta)};
  const Vec3 e_phi{-std::sin(phi), std::cos(phi), 0};
  camera.frame_from_camera.rotation = {
      {e_phi.x, e_theta.x, -d.x, e_phi.y, e_theta.y, -d.y, e_phi.z, e_theta.z, -d.z}};
  camera.frame_from_camera.translation = t.Number("distance_mm", {1, 1e5}) * d;
  camera.width = static_cast<int>(t.Integer("width_px", {8, 16384}));
  camera.height = static_cast<int>(t.Integer("height_px", {8, 16384}));
  camera.focal_px = t.Number("focal_px", {1, 1e6});
  camera.cx = t.NumberOr("cx_px", camera.width / 2.0, {-1e5, 1e5});
  camera.cy = t.NumberOr("cy_px", camera.height / 2.0, {-1e5, 1e5});
  camera.pattern =
      t.Word("pattern", {"mono", "RGGB"}) == "RGGB" ? BayerPattern::kRggb : BayerPattern::kMono;
  camera.bits = static_cast<int>(t.Integer("bits", {8, 12}));
  if (camera.bits != 8 && camera.bits != 12) t.Error("bits", "permitted is 8 or 12");
  camera.black_dn = static_cast<int>(t.Integer("black_dn", {0, 1024}));
  if (camera.black_dn * 2 > camera.white_dn()) t.Error("black_dn", "is over half the code range");
  camera.full_well_e = t.Number("full_well_e", {10, 1e7});
  camera.read_noise_e = t.Number("read_noise_e", {0, 1e4});
  camera.electrons_per_radiance_s = t.Number("electrons_per_radiance_s", {1e-6, 1e15});
  camera.min_exposure_s = t.Number("min_exposure_s", {1e-7, 1000});
  camera.max_exposure_s = t.Number("max_exposure_s", {1e-7, 1000});
  if (!(camera.min_exposure_s <= camera.max_exposure_s)) {
    t.Error("max_exposure_s", "must not be below min_exposure_s");
  }
  camera.readout_s = t.Number("readout_s", {0, 10});
  camera.trigger_latency_s = t.NumberOr("trigger_latency_s", 0.001, {1e-6, 1});
  return camera;
}

void ReadSolid(TomlTable t, Rig& rig) {
  Solid solid;
  solid.name = t.String("name");
  const std::string kind = t.Word("kind", {"capsule", "arc"});
  solid.frame = ReadFrameName(t, rig, "frame");
  solid.radius_mm = t.Number("radius_mm", {0.1, 1e4});
  if (kind == "capsule") {
    solid.a_in_frame = t.Vector("a_mm", {-1e5, 1e5});
    solid.b_in_frame = t.Vector("b_mm", {-1e5, 1e5});
    rig.solids.push_back(solid);
    return;
  }
  // An arc around the frame's origin, as capsules of at most five degrees.
  const double arc_radius = t.Number("arc_radius_mm", {1, 1e5});
  const double from = t.Number("theta_from_deg", {-180, 180});
  const double to = t.Number("theta_to_deg", {-180, 180});
  const double phi = RadFromDeg(t.NumberOr("phi_deg", 0, {-360, 360}));
  const int pieces = std::max(1, static_cast<int>(std::ceil(std::abs(to - from) / 5)));
  const auto point = [&](int i) {
    return arc_radius * DirectionFromAngles(RadFromDeg(from + (to - from) * i / pieces), phi);
  };
  for (int i = 0; i < pieces; ++i) {
    solid.a_in_frame = point(i);
    solid.b_in_frame = point(i + 1);
    rig.solids.push_back(solid);
  }
}

Laser ReadLaser(TomlTable t, const Rig& rig) {
  Laser laser;
  laser.name = t.String("name");
  laser.frame = ReadFrameName(t, rig, "frame");
  laser.motor_port = static_cast<int>(t.Integer("motor_port", {0, 2}));
  laser.gear_ratio = t.Number("gear_ratio", {0.01, 1e6});
  laser.backlash_rad = RadFromDeg(t.Number("backlash_deg", {0, 3600}));
  laser.full_speed_rad_s = RadFromDeg(t.Number("full_speed_deg_s", {1, 1e5}));
  laser.max_tilt_rad = RadFromDeg(t.Number("max_tilt_deg", {0.01, 60}));
  laser.fan_rad = RadFromDeg(t.Number("fan_deg", {0.1, 170}));
  laser.fwhm_mm = t.Number("fwhm_mm", {1e-3, 100});
  laser.power_w = t.Number("power_w", {1e-9, 100});
  const Vec3 response = t.Vector("response", {0, 1});
  laser.response = {response.x, response.y, response.z};
  if (!(response.x + response.y + response.z > 0)) t.Error("response", "no pixel sees the laser");
  for (TomlTable m : t.Tables("mount")) {
    LaserMount mount;
    mount.name = m.String("name");
    mount.theta_rad = RadFromDeg(m.Number("theta_deg", {0, 89}));
    mount.distance_mm = m.Number("distance_mm", {1, 1e5});
    // The sheet must meet the turntable's plane at every tilt.
    if (mount.theta_rad + laser.max_tilt_rad > RadFromDeg(89)) {
      m.Error("theta_deg", "with the laser's max_tilt_deg is above 89");
    }
    laser.mounts.push_back(mount);
  }
  if (laser.mounts.empty()) t.Error("", "at least one [[laser.mount]] is needed");
  return laser;
}

void ReadLines(TomlTable t, Lines& lines) {
  lines.interlock = t.BoolOr("interlock", true);
  if (t.Has("power")) lines.power = static_cast<int>(t.Integer("power", {0, 63}));
  if (!lines.interlock) {
    lines.estop = lines.door = lines.reset = -1;
    return;
  }
  lines.estop = static_cast<int>(t.Integer("estop", {0, 63}));
  lines.door = static_cast<int>(t.Integer("door", {0, 63}));
  lines.reset = static_cast<int>(t.Integer("reset", {0, 63}));
}

void ReadLaserSection(TomlTable root, Rig& rig) {
  if (root.Has("turntable")) {
    TomlTable t = root.Table("turntable");
    rig.turntable = Turntable{t.Number("radius_mm", {1, 1e4}), t.Number("albedo", {0, 1})};
  }
  if (!root.Has("laser")) return;
  rig.laser = ReadLaser(root.Table("laser"), rig);
  if (!rig.turntable) root.Error("", "a rig with a [laser] needs its [turntable]");
  TomlTable lines = root.Table("lines");
  rig.lines.laser_trigger = static_cast<int>(lines.Integer("laser_trigger", {0, 63}));
  rig.lines.laser_on = static_cast<int>(lines.Integer("laser_on", {0, 63}));
}

void CheckUnique(TomlTable root, const Rig& rig) {
  Unique<std::string> axes, frames, lamps, cameras, serials;
  Unique<int> nodes, channels, lines;
  TomlTable line_table = root.Table("lines");
  if (rig.lines.interlock) {
    lines.Add(line_table, "estop", rig.lines.estop);
    lines.Add(line_table, "door", rig.lines.door);
    lines.Add(line_table, "reset", rig.lines.reset);
  }
  if (rig.lines.power >= 0) lines.Add(line_table, "power", rig.lines.power);
  size_t i = 0;
  if (rig.laser) {
    lines.Add(line_table, "laser_trigger", rig.lines.laser_trigger);
    lines.Add(line_table, "laser_on", rig.lines.laser_on);
    Unique<std::string> mounts;
    TomlTable laser = root.Table("laser");
    for (TomlTable t : laser.Tables("mount")) mounts.Add(t, "name", rig.laser->mounts[i++].name);
    i = 0;
  }
  for (TomlTable t : root.Tables("axis")) {
    axes.Add(t, "name", rig.axes[i].name);
    nodes.Add(t, "can_node", rig.axes[i++].can_node);
  }
  i = 0;
  for (TomlTable t : root.Tables("frame")) frames.Add(t, "name", rig.frames[i++].name);
  i = 0;
  for (TomlTable t : root.Tables("lamp")) {
    lamps.Add(t, "name", rig.lamps[i].name);
    channels.Add(t, "channel", rig.lamps[i++].channel);
  }
  i = 0;
  for (TomlTable t : root.Tables("camera")) {
    cameras.Add(t, "name", rig.cameras[i].name);
    serials.Add(t, "serial", rig.cameras[i++].serial);
  }
}

}  // namespace

StatusOr<Rig> ParseRig(std::string_view text, std::string_view name) {
  MESORIG_ASSIGN_OR_RETURN(TomlFile file, TomlFile::Parse(text, name));
  TomlTable root = file.root();
  Rig rig;
  rig.name = root.String("name");
  rig.sample_radius_mm = root.Number("sample_radius_mm", {0.1, 1e4});
  rig.heartbeat_s = root.NumberOr("heartbeat_s", 0.5, {0.01, 60});
  if (root.Has("mains_hz")) rig.mains_hz = root.Number("mains_hz", {10, 1000});
  for (TomlTable t : root.Tables("axis")) rig.axes.push_back(ReadAxis(t));
  for (TomlTable t : root.Tables("frame")) rig.frames.push_back(ReadFrame(t, rig));
  if (!rig.FindFrame("sample")) root.Error("", "a [[frame]] named \"sample\" is missing");
  for (TomlTable t : root.Tables("lamp")) rig.lamps.push_back(ReadLamp(t, rig));
  for (TomlTable t : root.Tables("camera")) rig.cameras.push_back(ReadCamera(t, rig));
  for (TomlTable t : root.Tables("solid")) ReadSolid(t, rig);
  if (rig.cameras.empty()) root.Error("", "at least one [[camera]] is needed");
  if (rig.lamps.empty()) root.Error("", "at least one [[lamp]] is needed");
  TomlTable bank = root.Table("lamp_bank");
  rig.lamp_bank.unit = static_cast<int>(bank.Integer("unit", {1, 247}));
  rig.lamp_bank.timeout_s = bank.Number("timeout_s", {0.05, 60});
  rig.lamp_bank.housing_temperatures = bank.BoolOr("housing_temperatures", false);
  if (bank.Has("max_housing_c")) {
    rig.lamp_bank.max_housing_c = bank.Number("max_housing_c", {30, 1000});
    if (!rig.lamp_bank.housing_temperatures) {
      bank.Error("max_housing_c",
                 "limits what the bank does not measure (`housing_temperatures = true` says that it does)");
    }
  }
  if (bank.Has("rated_hours")) rig.lamp_bank.rated_hours = bank.Number("rated_hours", {1, 1e6});
  ReadLines(root.Table("lines"), rig.lines);
  ReadLaserSection(root, rig);
  if (auto buses = root.TableIfPresent("buses")) rig.buses = ReadBuses(*buses, rig.lines);
  CheckUnique(root, rig);
  MESORIG_RETURN_IF_ERROR(file.Finish());
  rig.source_text = text;
  rig.sha256 = Sha256(text);
  return rig;
}

StatusOr<Rig> LoadRig(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, 4u << 20));
  return ParseRig(text, path.string());
}

}  // namespace mesorig
