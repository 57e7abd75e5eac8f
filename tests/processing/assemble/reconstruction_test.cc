// Why the pictures are reconstructed as they are: every candidate against the truth, on a textured
// plane with hue that changes at the threads. The table is in processing/image/README.md; run with
// --gtest_filter=Reconstruction* to see it.

#include <gtest/gtest.h>

#include <array>
#include <map>
#include <random>

#include "processing/image/demosaic.h"
#include "processing/image/radiance.h"
#include "protocol/rig/rig_geometry.h"
#include "tests/processing/assemble/synthetic_session.h"

namespace mesorig::assemble {
namespace {

// Threads 4.3 mm wide, two dyes, curved shading, fine grain of all colours alike, a ring.
class Weave {
 public:
  Weave() {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> phase(0, 2 * kPi);
    for (int k = 0; k < 40; ++k) {
      const double wavelength = 0.5 * std::pow(40.0, k / 39.0), a = phase(random);
      waves_.push_back({2 * kPi / wavelength * std::cos(a), 2 * kPi / wavelength * std::sin(a),
                        phase(random), 0.02 * std::sqrt(wavelength)});
    }
  }
  double operator()(double x, double y, int c) const {
    const double ux = x / 4.3, uy = y / 4.3;
    const bool warp = (static_cast<int>(std::floor(ux)) + static_cast<int>(std::floor(uy))) % 2 != 0;
    const double d = (warp ? ux - std::floor(ux) : uy - std::floor(uy)) - 0.5;
    const std::array<double, 3> dye[3] = {{0.45, 0.25, 0.2}, {0.3, 0.33, 0.4}, {0.7, 0.62, 0.3}};
    const double r = std::hypot(x - 3, y - 5);
    const auto& albedo = dye[r < 5 && r > 3.4 ? 2 : warp ? 1 : 0];
    double grain = 1;
    for (const Wave& w : waves_) grain += w.a * std::cos(w.kx * x + w.ky * y + w.phase);
    return albedo[static_cast<size_t>(c)] * (0.55 + 0.45 * std::sqrt(1 - 3.6 * d * d)) *
           std::max(0.05, grain) / kPi;
  }

 private:
  struct Wave {
    double kx, ky, phase, a;
  };
  std::vector<Wave> waves_;
};

using image::RgbImage;

float At(const image::MosaicImage& m, int column, int row) {
  column = std::clamp(column, 2, m.width - 3), row = std::clamp(row, 2, m.height - 3);
  return m.radiance[static_cast<size_t>(row * m.width + column)];
}

// Each colour from its own pixels alone, bilinear.
RgbImage OwnColour(const image::MosaicImage& m) {
  RgbImage out{m.width, m.height, std::vector<float>(m.radiance.size() * 3), {}};
  for (int row = 0; row < m.height; ++row) {
    for (int column = 0; column < m.width; ++column) {
      std::array<float, 3> sum{}, weight{};
      for (int k = 0; k < 9; ++k) {
        const int a = k % 3 - 1, b = k / 3 - 1;
        const auto c = static_cast<size_t>(image::ColourAt(m.pattern, column + a, row + b));
        const bool own = c == static_cast<size_t>(image::ColourAt(m.pattern, column, row));
        const float w = own ? (k == 4 ? 1.0f : 0.0f) : 1.0f;  // green's diagonal is green too
        sum[c] += w * At(m, column + a, row + b), weight[c] += w;
      }
      for (size_t c = 0; c < 3; ++c) {
        out.rgb[3 * static_cast<size_t>(row * m.width + column) + c] = sum[c] / weight[c];
      }
    }
  }
  return out;
}

// Malvar et al. 2004, gains 1/2, 5/8 and 3/4, on channels balanced to the lamp's colour.
RgbImage Malvar(image::MosaicImage m, const std::array<double, 3>& white) {
  for (int k = 0; k < m.width * m.height; ++k) {
    const size_t c = static_cast<size_t>(image::ColourAt(m.pattern, k % m.width, k / m.width));
    m.radiance[static_cast<size_t>(k)] /= static_cast<float>(white[c]);
  }
  RgbImage out = OwnColour(m);
  for (int row = 2; row < m.height - 2; ++row) {
    for (int column = 2; column < m.width - 2; ++column) {
      const auto at = [&](int a, int b) { return At(m, column + a, row + b); };
      float* rgb = out.rgb.data() + 3 * static_cast<size_t>(row * m.width + column);
      const int own = image::ColourAt(m.pattern, column, row);
      const float far = at(-2, 0) + at(2, 0) + at(0, -2) + at(0, 2);
      if (own != 1) {
        rgb[1] += (4 * at(0, 0) - far) / 8;
        rgb[2 - own] += 3 * (4 * at(0, 0) - far) / 16;
        continue;
      }
      const float near = 5 * at(0, 0) - at(-1, -1) - at(1, -1) - at(-1, 1) - at(1, 1);
      const float across = at(-2, 0) + at(2, 0), along = at(0, -2) + at(0, 2);
      const int beside = image::ColourAt(m.pattern, column + 1, row);
      rgb[beside] += (near - across + along / 2) / 8;
      rgb[2 - beside] += (near - along + across / 2) / 8;
    }
  }
  for (size_t k = 0; k < out.rgb.size(); ++k) out.rgb[k] *= static_cast<float>(white[k % 3]);
  return out;
}

// Each colour's samples weighted by a Gaussian of the texel's footprint and `sigma` pixels more.
std::array<double, 3> FootprintMean(const image::MosaicImage& m, const Camera& camera,
                                    const RigidTransform& camera_from_sample, Vec3 p, double pitch,
                                    double sigma) {
  const ImagePoint o = *Project(camera, camera_from_sample * p);
  const ImagePoint a = *Project(camera, camera_from_sample * (p + Vec3{pitch, 0, 0}));
  const ImagePoint b = *Project(camera, camera_from_sample * (p + Vec3{0, pitch, 0}));
  const double au = a.u - o.u, av = a.v - o.v, bu = b.u - o.u, bv = b.v - o.v;
  const double uu = (au * au + bu * bu) / 12 + sigma * sigma, uv = (au * av + bu * bv) / 12,
               vv = (av * av + bv * bv) / 12 + sigma * sigma, det = uu * vv - uv * uv;
  std::array<double, 3> sum{}, weight{};
  for (int row = static_cast<int>(o.v) - 5; row <= static_cast<int>(o.v) + 5; ++row) {
    for (int column = static_cast<int>(o.u) - 5; column <= static_cast<int>(o.u) + 5; ++column) {
      const double du = column + 0.5 - o.u, dv = row + 0.5 - o.v;
      const double g = std::exp(-(vv * du * du - 2 * uv * du * dv + uu * dv * dv) / (2 * det));
      const size_t c = static_cast<size_t>(image::ColourAt(m.pattern, column, row));
      sum[c] += g * static_cast<double>(At(m, column, row)), weight[c] += g;
    }
  }
  for (size_t c = 0; c < 3; ++c) sum[c] /= weight[c];
  return sum;
}

class Score {
 public:
  void Add(double difference) { squares_ += difference * difference, ++count_; }
  double PsnrDb() const { return -10 * std::log10(squares_ / count_ * kPi * kPi); }

 private:
  double squares_ = 0, count_ = 0;
};

TEST(Reconstruction, TheChosenOneIsTheBestOnAverage) {
  const Rig rig = DemoRig();
  const Weave weave;
  btf::BtfHeader grid;
  grid.width = grid.height = 48, grid.pitch_mm = 0.5, grid.h_ref_mm = 4.5;
  std::vector<double> truth;
  for (int t = 0; t < 48 * 48; ++t) {
    const Vec3 p = grid.TexelCentre(t % 48, t / 48);
    for (int c = 0; c < 3; ++c) {
      double sum = 0;
      for (int s = 0; s < 64; ++s) sum += weave(p.x + (s % 8 - 3.5) / 16, p.y + (s / 8 - 3.5) / 16, c);
      truth.push_back(sum / 64);
    }
  }
  std::map<std::string, double> mean;
  for (const int k : {0, 2, 4, 5, 7}) {
    const Camera& camera = rig.cameras[static_cast<size_t>(k)];
    const Shot shot{20, 90, 2};
    const std::string bytes =
        Render(camera, kCameraThetaDeg[static_cast<size_t>(k)], shot,
               [&](double x, double y, int c) { return std::abs(x) < 14 && std::abs(y) < 14 ? weave(x, y, c) : 0.1; }, 4);
    const image::MosaicImage mosaic = image::LinearRadiance(camera, bytes, 0.02).value();
    const RigidTransform pose = SampleFromCamera(rig, k, std::vector<double>{RadFromDeg(20), RadFromDeg(90)});
    const RectifyMap map = RectifyMap::Build(camera, pose, grid).value();
    std::map<std::string, Score> scores;
    const auto irradiance = [&](Vec3 p, size_t c) {
      return RadianceOf(shot, [](double, double, int) { return 1.0; }, p.x, p.y, static_cast<int>(c));
    };
    const auto mapped = [&](const std::string& name, const RgbImage& picture) {
      std::vector<float> values(truth.size());
      map.Apply(picture, values);
      for (size_t i = 0; i < truth.size(); ++i) {
        const Vec3 p = grid.TexelCentre(static_cast<int>(i / 3) % 48, static_cast<int>(i / 3) / 48);
        scores[name].Add(static_cast<double>(values[i]) / irradiance(p, i % 3) - truth[i]);
      }
    };
    mapped("chosen: local lines, centre values", image::Demosaic(mosaic).value());
    mapped("local lines, pixel means", image::Demosaic(mosaic, image::PixelModel::kAverage).value());
    mapped("own colour alone, pixel means", OwnColour(mosaic));
    mapped("Malvar 2004", Malvar(mosaic, {24, 20, 14}));
    for (const double sigma : {0.4, 0.6}) {
      for (size_t t = 0; t < truth.size() / 3; ++t) {
        const Vec3 p = grid.TexelCentre(static_cast<int>(t) % 48, static_cast<int>(t) / 48);
        const auto rgb = FootprintMean(mosaic, camera, Inverse(pose), p, 0.5, sigma);
        for (size_t c = 0; c < 3; ++c) {
          scores[fmt::format("footprint mean, {} px", sigma)].Add(rgb[c] / irradiance(p, c) - truth[3 * t + c]);
        }
      }
    }
    for (const auto& [name, score] : scores) {
      fmt::print("theta {:4} {:36} {:.2f} dB\n", kCameraThetaDeg[static_cast<size_t>(k)], name, score.PsnrDb());
      mean[name] += score.PsnrDb() / 5;
    }
  }
  for (const auto& [name, psnr] : mean) {
    fmt::print("mean       {:36} {:.2f} dB\n", name, psnr);
    EXPECT_GE(mean["chosen: local lines, centre values"] + 0.05, psnr) << name;
  }
}

}  // namespace
}  // namespace mesorig::assemble
