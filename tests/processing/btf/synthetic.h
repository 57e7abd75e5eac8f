#pragma once
// Small BTFs with known values, for tests.

#include <cmath>
#include <filesystem>
#include <random>
#include <string>

#include "processing/btf/sampled_btf.h"

namespace mesorig::btf {

// A folder of this test process, removed with it.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "mesorig-test-XXXXXX").string();
    path_ = ::mkdtemp(pattern.data());
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  std::filesystem::path operator/(std::string_view name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// The pole, then `rings` rings of `per_ring` directions up to `max_theta_deg`.
inline std::vector<Vec3> RingDirections(int rings, int per_ring, double max_theta_deg) {
  std::vector<Vec3> directions = {{0, 0, 1}};
  for (int r = 1; r <= rings; ++r) {
    for (int k = 0; k < per_ring; ++k) {
      directions.push_back(DirectionFromAngles(RadFromDeg(max_theta_deg * r / rings),
                                               2 * kPi * k / per_ring + 0.1 * r));
    }
  }
  return directions;
}

inline BtfHeader SmallHeader(int width, int height, std::vector<Vec3> views,
                             std::vector<Vec3> lights) {
  BtfHeader header;
  header.width = width;
  header.height = height;
  header.pitch_mm = 0.5;
  header.h_ref_mm = 3.25;
  header.views = std::move(views);
  header.lights = std::move(lights);
  header.provenance_json = R"({"made_by":"test"})";
  return header;
}

// A smooth, non-Lambertian function of texel and directions, times the light's cosine.
inline float SyntheticValue(const BtfHeader& h, int texel, int channel, Vec3 v, Vec3 l) {
  const double s = 0.5 + 0.4 * std::sin(0.7 * texel + channel);
  const Vec3 half = Normalized(v + l);
  const double gloss = std::pow(std::max(0.0, half.z), 20.0 + 10 * s);
  const double tilt = 1 + 0.3 * s * (l.x * v.y - l.y * v.x);
  (void)h;
  return static_cast<float>((s * tilt / kPi + 0.2 * gloss) * std::max(0.0, l.z));
}

// Every pair present, except the fraction `absent` chosen by a fixed generator.
inline SampledBtf SyntheticBtf(const BtfHeader& header, double absent = 0) {
  SampledBtf btf(header);
  std::mt19937 random(7);
  for (int v = 0; v < header.view_count(); ++v) {
    for (int l = 0; l < header.light_count(); ++l) {
      if (static_cast<double>(random()) < absent * 4294967296.0) continue;
      btf.SetPresent(v, l, true);
      auto image = btf.MutableImage(v, l);
      for (size_t i = 0; i < image.size(); ++i) {
        image[i] = SyntheticValue(header, static_cast<int>(i / 3), static_cast<int>(i % 3),
                                  header.views[static_cast<size_t>(v)],
                                  header.lights[static_cast<size_t>(l)]);
      }
    }
  }
  return btf;
}

}  // namespace mesorig::btf
