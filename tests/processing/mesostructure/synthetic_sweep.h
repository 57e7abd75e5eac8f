#pragma once
// Frames of laser sweeps over reliefs, made without the geometry code of the product: poses,
// projection and the pencil of planes are written out from docs/laser.md. Camera at polar angle
// theta and azimuth 0 of the world, image right e_phi, image down e_theta; p_world = Rz(turntable)
// p_sample.

#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "processing/mesostructure/mdf_builder.h"

namespace mesorig::mesostructure {

inline Rig DemoRig() {
  return LoadRig(std::string(MESORIG_SOURCE_DIR) + "/rigs/demo.toml").value();
}

inline constexpr double kCameraMm = 800, kReferenceMm = 4.2, kHalfExtentMm = 20;
inline const std::vector<double> kCameraThetaDeg = {0, 15, 30, 40, 50, 60, 68, 75};

// Height above the turntable, mm, inside the sample's footprint; 0 <= z <= kReferenceMm.
using Relief = std::function<double(double x, double y)>;

struct SweepScene {
  Relief relief;
  double turntable_deg = 0, light_arc_deg = 0;
  double mount_theta_deg = 35, mount_mm = 640, fwhm_mm = 2.4;
  double peak_e = 3500, exposure_s = 0.02;
  double tilt_error_deg = 0.4;          // of the tachometer
  bool laser_on = true, ghost = false;  // ghost: a second sheet, 10 mm aside
  unsigned seed = 1;
};

class SyntheticSweep {
 public:
  SyntheticSweep(const Rig& rig, const CompiledPlan& plan, const Step& step, int camera,
                 const SweepScene& scene)
      : camera_(rig.cameras[static_cast<size_t>(camera)]),
        theta_deg_(kCameraThetaDeg[static_cast<size_t>(camera)]),
        step_(step),
        scene_(scene),
        laser_(*rig.laser),
        random_(scene.seed * 1000 + static_cast<unsigned>(camera)) {
    (void)plan;
    for (size_t k = 0; k < step.cameras.size(); ++k) {
      if (step.cameras[k] == camera) region_ = step.sweep.regions[k];
    }
    frame_.camera = camera, frame_.exposure_s = scene.exposure_s;
    frame_.axis_rad = {scene.turntable_deg * kPi / 180, scene.light_arc_deg * kPi / 180};
    frame_.lamp_level.assign(rig.lamps.size(), 0.0);
    frame_.sweep = step.sweep.index, frame_.mount = step.sweep.mount;
    frame_.region = region_, frame_.on = scene.laser_on;
    LookAtRelief();
  }

  // Where the sheet really stands: off the tachometer, and not quite steady.
  double TrueTilt(uint32_t index) const {
    const double share = static_cast<double>(index) / (step_.sweep.frames - 1);
    const double steady =
        step_.sweep.tilt_from_rad + share * (step_.sweep.tilt_to_rad - step_.sweep.tilt_from_rad);
    return steady + scene_.tilt_error_deg * kPi / 180 + 2e-4 * std::sin(0.3 * index);
  }

  SweepFrame Frame(uint32_t index, uint64_t sequence) const {
    SweepFrame frame = frame_;
    frame.index = index, frame.sequence = sequence, frame.shot = step_.shot + index;
    frame.tilt_rad = TrueTilt(index) - scene_.tilt_error_deg * kPi / 180;
    return frame;
  }

  std::string Pixels(uint32_t index) {
    std::normal_distribution<double> normal;
    std::string bytes;
    const double tilt = TrueTilt(index);
    const double sigma = scene_.fwhm_mm / 2.3548200450309493;
    for (size_t k = 0; k < hits_.size() / kRays; ++k) {
      double sum = 0;
      for (size_t ray = 0; ray < kRays; ++ray) {
        const Hit& hit = hits_[kRays * k + ray];
        if (!hit.lit || !scene_.laser_on) continue;
        const double s = hit.radius * std::sin(hit.tilt - tilt);
        sum += std::exp(-0.5 * s * s / (sigma * sigma));
        if (scene_.ghost) sum += 0.9 * std::exp(-0.5 * (s - 10) * (s - 10) / (sigma * sigma));
      }
      const int column = static_cast<int>(k) % region_.width;
      const int row = static_cast<int>(k) / region_.width;
      const size_t colour = row % 2 == 0 ? (column % 2 == 0 ? 0 : 1) : (column % 2 == 0 ? 1 : 2);
      const double mean = scene_.peak_e * laser_.response[colour] * sum / kRays;
      const double noisy =
          mean + std::sqrt(mean + camera_.read_noise_e * camera_.read_noise_e) * normal(random_);
      const double code =
          camera_.black_dn + noisy * (4095 - camera_.black_dn) / camera_.full_well_e;
      const int dn = static_cast<int>(std::lround(std::min(4095.0, std::max(0.0, code))));
      bytes.push_back(static_cast<char>(dn & 0xff));
      bytes.push_back(static_cast<char>(dn >> 8));
    }
    return bytes;
  }

  uint32_t frames() const { return step_.sweep.frames; }

 private:
  static constexpr size_t kRays = 4;
  struct Hit {
    double tilt = 0, radius = 0;
    bool lit = false;
  };

  double HeightAt(double x, double y) const {
    if (std::abs(x) > kHalfExtentMm || std::abs(y) > kHalfExtentMm) return 0;
    return scene_.relief(x, y);
  }

  // From p along d (unit) in small steps: the first point at or below the relief.
  bool March(Vec3 p, Vec3 d, double length, Vec3& hit) const {
    constexpr double kStep = 0.04;
    for (double way = 0; way < length; way += kStep) {
      const Vec3 q = p + way * d;
      if (q.z <= HeightAt(q.x, q.y)) {
        hit = q;
        return true;
      }
    }
    return false;
  }

  Hit HitOf(double u, double v) const {
    const double theta = theta_deg_ * kPi / 180, tau = scene_.turntable_deg * kPi / 180;
    const double s = std::sin(theta), c = std::cos(theta);
    const double right = (u - camera_.cx) / camera_.focal_px;
    const double down = (v - camera_.cy) / camera_.focal_px;
    // World: -d + right e_phi + down e_theta; then turned by -tau.
    const Vec3 w{-s + down * c, right, -c - down * s};
    const auto turn = [&](Vec3 p) {
      return Vec3{p.x * std::cos(tau) + p.y * std::sin(tau),
                  -p.x * std::sin(tau) + p.y * std::cos(tau), p.z};
    };
    const Vec3 d = Normalized(turn(w)), camera = turn({kCameraMm * s, 0, kCameraMm * c});
    const Vec3 top = camera + ((kReferenceMm + 0.01 - camera.z) / d.z) * d;
    Vec3 p;
    if (!March(top, d, 2 * kReferenceMm / std::abs(d.z), p)) return {};
    // docs/laser.md: source, axis a = azimuth + 90 degrees, x(t) falls with the tilt.
    const double azimuth = (scene_.light_arc_deg - scene_.turntable_deg) * kPi / 180;
    const double mount = scene_.mount_theta_deg * kPi / 180;
    const double source_r = scene_.mount_mm * std::sin(mount);
    const double source_z = scene_.mount_mm * std::cos(mount);
    const double dr = p.x * std::cos(azimuth) + p.y * std::sin(azimuth) - source_r;
    const double dz = p.z - source_z;
    const Vec3 source{source_r * std::cos(azimuth), source_r * std::sin(azimuth), source_z};
    const Vec3 l = Normalized(source - p);
    Vec3 ignored;
    const bool shadow = March(p + 0.12 * l, l, (kReferenceMm - p.z) / l.z, ignored);
    return {std::atan2(-dr, -dz) - mount, std::hypot(dr, dz), !shadow};
  }

  void LookAtRelief() {
    for (int j = 0; j < region_.height; ++j) {
      for (int i = 0; i < region_.width; ++i) {
        for (size_t ray = 0; ray < kRays; ++ray) {
          hits_.push_back(HitOf(region_.x + i + 0.25 + 0.5 * static_cast<double>(ray % 2),
                                region_.y + j + 0.25 + 0.5 * static_cast<double>(ray / 2)));
        }
      }
    }
  }

  const Camera camera_;
  const double theta_deg_;
  const Step& step_;
  const SweepScene scene_;
  const Laser laser_;
  std::mt19937 random_;
  Region region_;
  SweepFrame frame_;
  std::vector<Hit> hits_;
};

// Sweeps of mount "slant" at these angles; 64 x 64 texels of 0.625 mm.
inline std::string SweepPlanText(const std::string& turntable_deg, const std::string& arc_deg,
                                 const std::string& cameras, int frames = 64) {
  return fmt::format(
      "name = \"test\"\n[sample]\nname = \"relief\"\nextent_mm = 40\n[product]\nwidth_px = 64\n"
      "height_px = 64\npitch_mm = 0.625\nh_ref_mm = 4.2\n[[sweep]]\nmounts = [\"slant\"]\n"
      "cameras = [{2}]\nexposure_s = 0.02\nframe_rate_hz = 7.5\nframes = {3}\nfrom_mm = -34\n"
      "to_mm = 34\nregion_radius_mm = 36\nkeep = \"displacements\"\n[sweep.axes.turntable]\n"
      "angles_deg = [{0}]\n[sweep.axes.light_arc]\nangles_deg = [{1}]\n",
      turntable_deg, arc_deg, cameras, frames);
}

}  // namespace mesorig::mesostructure
