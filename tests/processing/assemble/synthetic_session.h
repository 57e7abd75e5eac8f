#pragma once
// Pictures of a textured reference plane, made without the geometry code of the product: camera
// axes, rotation and projection are written out here from the text of docs and rig file (camera at
// polar angle theta and azimuth 0 of the world, image right e_phi, image down e_theta; p_world =
// Rz(turntable) p_sample).

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "processing/assemble/assembler.h"
#include "protocol/rig/rig.h"

namespace mesorig::assemble {

inline Rig DemoRig() { return LoadRig(std::string(MESORIG_SOURCE_DIR) + "/rigs/demo.toml").value(); }

inline constexpr double kCameraMm = 800, kLampMm = 650;
inline const std::vector<double> kCameraThetaDeg = {0, 15, 30, 40, 50, 60, 68, 75};
inline const std::vector<double> kLampThetaDeg = {8, 20, 30, 40, 50, 60, 68, 75};

// BTF value of colour c at (x, y) of the reference plane, sample frame, mm.
using Texture = std::function<double(double x, double y, int c)>;

struct Shot {
  double turntable_deg = 0, light_arc_deg = 0;
  int lamp = 0;
  double h_ref_mm = 4.5, exposure_s = 0.02;
};

inline Vec3 LampOf(const Shot& shot) {
  const double theta = kLampThetaDeg[static_cast<size_t>(shot.lamp)] * kPi / 180;
  const double azimuth = (shot.light_arc_deg - shot.turntable_deg) * kPi / 180;
  return {kLampMm * std::sin(theta) * std::cos(azimuth),
          kLampMm * std::sin(theta) * std::sin(azimuth), kLampMm * std::cos(theta)};
}

// Radiance W m^-2 sr^-1 of colour c of the plane's point (x, y): value times the irradiance of a
// plane perpendicular to the light.
inline double RadianceOf(const Shot& shot, const Texture& texture, double x, double y, int c) {
  const double intensity[3] = {24, 20, 14};
  const Vec3 lamp = LampOf(shot);
  const double dx = lamp.x - x, dy = lamp.y - y, dz = lamp.z - shot.h_ref_mm;
  return texture(x, y, c) * intensity[c] / ((dx * dx + dy * dy + dz * dz) * 1e-6);
}

// Mean over each pixel from n x n rays; 12-bit codes, little-endian.
inline std::string Render(const Camera& camera, double theta_deg, const Shot& shot,
                          const Texture& texture, int n = 3) {
  const double theta = theta_deg * kPi / 180, tau = shot.turntable_deg * kPi / 180;
  const double s = std::sin(theta), k = std::cos(theta);
  std::string bytes;
  for (int row = 0; row < camera.height; ++row) {
    for (int column = 0; column < camera.width; ++column) {
      const int c = row % 2 == 0 ? (column % 2 == 0 ? 0 : 1) : (column % 2 == 0 ? 1 : 2);
      double sum = 0;
      for (int sub = 0; sub < n * n; ++sub) {
        const double right = (column + (sub % n + 0.5) / n - camera.cx) / camera.focal_px;
        const double down = (row + (sub / n + 0.5) / n - camera.cy) / camera.focal_px;
        // world direction: -d + right e_phi + down e_theta
        const double wx = -s + down * k, wy = right, wz = -k - down * s;
        const double t = (shot.h_ref_mm - kCameraMm * k) / wz;
        const double x = kCameraMm * s + t * wx, y = t * wy;
        sum += RadianceOf(shot, texture, x * std::cos(tau) + y * std::sin(tau),
                          -x * std::sin(tau) + y * std::cos(tau), c);
      }
      const double electrons =
          sum / (n * n) * camera.electrons_per_radiance_s * shot.exposure_s;
      const double code = camera.black_dn + electrons * (4095 - camera.black_dn) / camera.full_well_e;
      const int dn = static_cast<int>(std::lround(std::min(4095.0, std::max(0.0, code))));
      bytes.push_back(static_cast<char>(dn & 0xff));
      bytes.push_back(static_cast<char>(dn >> 8));
    }
  }
  return bytes;
}

inline std::string Uniform(const Camera& camera, int code) {
  std::string bytes;
  for (int k = 0; k < camera.width * camera.height; ++k) {
    bytes.push_back(static_cast<char>(code & 0xff));
    bytes.push_back(static_cast<char>(code >> 8));
  }
  return bytes;
}

inline FrameInfo InfoOf(const Rig& rig, const Shot& shot, int camera, uint32_t shot_index,
                        uint64_t sequence) {
  FrameInfo info{sequence, camera, shot_index, shot.exposure_s, {}, {}};
  info.axis_rad = {shot.turntable_deg * kPi / 180, shot.light_arc_deg * kPi / 180};
  info.lamp_level.assign(rig.lamps.size(), 0.0);
  info.lamp_level[static_cast<size_t>(shot.lamp)] = 1;
  return info;
}

// A plan of one shot a (turntable, arc) with one lamp.
inline std::string PlanText(const std::string& turntable_deg, const std::string& arc_deg,
                            const std::string& lamps, const std::string& cameras, int size,
                            double pitch_mm) {
  return fmt::format(
      "name = \"test\"\n[sample]\nname = \"plane\"\n[product]\nwidth_px = {0}\nheight_px = {0}\n"
      "pitch_mm = {1}\nh_ref_mm = 4.5\n[[grid]]\nexposure_s = 0.02\nlamps = [{2}]\ncameras = [{3}]\n"
      "[grid.axes.turntable]\nangles_deg = [{4}]\n[grid.axes.light_arc]\nangles_deg = [{5}]\n",
      size, pitch_mm, lamps, cameras, turntable_deg, arc_deg);
}

}  // namespace mesorig::assemble
