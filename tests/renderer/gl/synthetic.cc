#include "tests/renderer/gl/synthetic.h"

#include <algorithm>

namespace mesorig::renderer {

std::vector<Vec3> Rings(double max_theta_rad, double spacing_rad) {
  std::vector<Vec3> directions = {{0, 0, 1}};
  const int rings = std::max(1, static_cast<int>(std::lround(max_theta_rad / spacing_rad)));
  for (int i = 1; i <= rings; ++i) {
    const double theta = max_theta_rad * i / rings;
    const int count = std::max(3, static_cast<int>(2 * kPi * std::sin(theta) / spacing_rad));
    for (int k = 0; k < count; ++k) {
      directions.push_back(DirectionFromAngles(theta, 2 * kPi * (k + 0.3 * i) / count));
    }
  }
  return directions;
}

btf::SampledBtf MakeBtf(int width, int height, double pitch_mm, const std::vector<Vec3>& views,
                        const std::vector<Vec3>& lights,
                        const std::function<double(int, int, Vec3, Vec3)>& value) {
  btf::BtfHeader header;
  header.width = width;
  header.height = height;
  header.pitch_mm = pitch_mm;
  header.views = views;
  header.lights = lights;
  btf::SampledBtf btf(header);
  for (int v = 0; v < header.view_count(); ++v) {
    for (int l = 0; l < header.light_count(); ++l) {
      btf.SetPresent(v, l, true);
      const auto image = btf.MutableImage(v, l);
      size_t at = 0;
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          const double rgb =
              value(x, y, views[static_cast<size_t>(v)], lights[static_cast<size_t>(l)]);
          for (double tint : {1.0, 0.8, 0.6}) image[at++] = static_cast<float>(tint * rgb);
        }
      }
    }
  }
  return btf;
}

btf::SampledBtf MakeBumpyBtf(int size, const std::vector<Vec3>& views,
                             const std::vector<Vec3>& lights) {
  return MakeBtf(size, size, 40.0 / size, views, lights, [size](int x, int y, Vec3 v, Vec3 l) {
    const double a = 2 * kPi * (x + 0.5) / size, b = 2 * kPi * (y + 0.5) / size;
    const double slope_x = 0.5 * std::sin(2 * a) * std::cos(b);
    const double slope_y = 0.5 * std::cos(a) * std::sin(3 * b);
    const Vec3 n = Normalized({slope_x, slope_y, 1});
    const Vec3 half = Normalized(v + l);
    const double albedo = 0.25 + 0.2 * std::cos(a + 2 * b);
    const double lit = std::max(0.0, Dot(n, l));
    return (albedo / kPi + 0.4 * std::pow(std::max(0.0, Dot(n, half)), 20)) * lit;
  });
}

btf::Mdf MakeMdf(int size, double pitch_mm, const std::vector<Vec3>& views,
                 const std::function<double(int, int, Vec3)>& distance) {
  btf::MdfHeader header;
  header.width = header.height = size;
  header.pitch_mm = pitch_mm;
  header.h_ref_mm = 5;
  header.views = views;
  btf::Mdf mdf(header);
  for (int view = 0; view < header.view_count(); ++view) {
    const auto distances = mdf.MutableDistance(view);
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        distances[static_cast<size_t>(y * size + x)] =
            static_cast<float>(distance(x, y, views[static_cast<size_t>(view)]));
      }
    }
    const auto confidences = mdf.MutableConfidence(view);
    std::fill(confidences.begin(), confidences.end(), 1.0f);
  }
  return mdf;
}

namespace {

Scene OneLight(Vec3 light) {
  Scene scene;
  scene.image.width = 240;
  scene.image.height = 180;
  scene.image.msaa = 1;
  scene.lights.push_back({Normalized(light), {kPi, kPi, kPi}});
  scene.camera.fov_rad = RadFromDeg(30);
  return scene;
}

}  // namespace

Scene TorusScene(Vec3 light) {
  Scene scene = OneLight(light);
  scene.camera.eye_mm = {40, -220, 180};
  Object torus;
  torus.shape = Shape::kTorus;
  torus.major_radius_mm = 50;
  torus.minor_radius_mm = 22;
  scene.objects.push_back(torus);
  return scene;
}

Scene SlabFromAboveScene(Vec3 light) {
  Scene scene = OneLight(light);
  scene.camera.eye_mm = {0, 0, 150};
  scene.camera.up = {0, 1, 0};
  Object slab;
  slab.size_mm = {60, 60, 10};
  scene.objects.push_back(slab);
  return scene;
}

}  // namespace mesorig::renderer
