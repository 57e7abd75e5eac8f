#include "simulator/plant/sensor.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mesorig::plant {
namespace {

Camera TestCamera(int bits) {
  Camera camera;
  camera.name = "cam";
  camera.width = 200;
  camera.height = 100;
  camera.bits = bits;
  camera.black_dn = bits == 12 ? 64 : 8;
  camera.full_well_e = 20000;
  camera.read_noise_e = 8;
  return camera;
}

Region Whole(const Camera& camera) { return {0, 0, camera.width, camera.height}; }

std::vector<double> Codes(const Camera& camera, const std::string& bytes) {
  std::vector<double> codes;
  const auto* b = reinterpret_cast<const unsigned char*>(bytes.data());
  for (size_t i = 0; i < bytes.size(); i += camera.bytes_per_pixel()) {
    codes.push_back(camera.bytes_per_pixel() == 1 ? b[i] : b[i] + 256.0 * b[i + 1]);
  }
  return codes;
}

struct Moments {
  double mean = 0, variance = 0;
};
Moments MomentsOf(const std::vector<double>& values) {
  Moments m;
  const auto n = static_cast<double>(values.size());
  for (double v : values) m.mean += v;
  m.mean /= n;
  for (double v : values) m.variance += (v - m.mean) * (v - m.mean);
  m.variance /= n;
  return m;
}

Moments Expose(const Camera& camera, double expected_e, double gain = 1) {
  const std::vector<float> expected(20000, static_cast<float>(expected_e));
  NoiseKey key{.seed = 3, .camera_serial = "A", .axis_counts = {1, 2}, .lamp_levels = {1, 0},
               .exposure_us = 10000, .gain = gain, .repeat_index = 0};
  return MomentsOf(Codes(camera, ReadOut(camera, Whole(camera), expected, key).value()));
}

// Photon transfer curve: in electrons, variance = mean + read noise^2 (+ 1/12 of a code squared).
TEST(Sensor, PhotonTransferCurve) {
  for (int bits : {8, 12}) {
    const Camera camera = TestCamera(bits);
    const double dn_per_e = (camera.white_dn() - camera.black_dn) / camera.full_well_e;
    for (double e : {50.0, 200.0, 1000.0, 5000.0, 15000.0}) {
      if (dn_per_e * std::sqrt(e + 64) < 0.5) continue;  // under half a code no noise is uniform
      const Moments dn = Expose(camera, e);
      const double variance = dn_per_e * dn_per_e * (e + 64) + 1 / 12.0;
      EXPECT_NEAR(dn.mean, camera.black_dn + dn_per_e * e, 5 * std::sqrt(variance / 20000) + 1e-3)
          << bits << " bits, " << e;
      EXPECT_NEAR(dn.variance / variance, 1, 5 * std::sqrt(2.0 / 20000) + 0.01)
          << bits << " bits, " << e;
    }
  }
}

TEST(Sensor, GainScalesCodes) {
  const Camera camera = TestCamera(12);
  const double dn_per_e = 4 * (4095 - 64) / 20000.0;
  EXPECT_NEAR(Expose(camera, 1000, 4).mean, 64 + dn_per_e * 1000, 0.5);
}

// With noise of a code or more the mean of the codes is the mean of the light: rounding, not
// truncation, in steps of a tenth of a code.
TEST(Sensor, QuantisationIsUnbiased) {
  Camera camera = TestCamera(12);
  camera.read_noise_e = 12;  // 2.4 codes
  const double dn_per_e = (4095 - 64) / 20000.0;
  for (int step = 0; step < 10; ++step) {
    const double e = 500 + step * 0.1 / dn_per_e;
    const double sd = std::sqrt((dn_per_e * dn_per_e * (e + 144) + 1 / 12.0) / 20000);
    EXPECT_NEAR(Expose(camera, e).mean, 64 + dn_per_e * e, 4 * sd);
  }
}

TEST(Sensor, FullWellAndDark) {
  Camera camera = TestCamera(12);
  EXPECT_NEAR(Expose(camera, 0).mean, 64, 0.1);
  camera.read_noise_e = 0;
  const Moments full = Expose(camera, 1e30);
  EXPECT_EQ(full.mean, 4095);
  EXPECT_EQ(full.variance, 0);
  EXPECT_EQ(Expose(camera, 0).mean, 64);
  EXPECT_EQ(Expose(camera, 1e7, 0.5).mean, std::floor(64 + 0.5 * 4031 + 0.5));  // the well, not ADC
}

TEST(Sensor, EqualKeysEqualBytesAndEveryFieldCounts) {
  const Camera camera = TestCamera(12);
  const std::vector<float> expected(20000, 3000.f);
  const NoiseKey key{.seed = 3, .camera_serial = "A", .axis_counts = {1, 2},
                     .lamp_levels = {1, 0}, .exposure_us = 10000, .gain = 1, .repeat_index = 0};
  const std::string bytes = ReadOut(camera, Whole(camera), expected, key).value();
  EXPECT_EQ(bytes, ReadOut(camera, Whole(camera), expected, key).value());
  std::vector<NoiseKey> others(10, key);
  others[0].seed = 4;
  others[1].camera_serial = "B";
  others[2].axis_counts = {1, 3};
  others[3].lamp_levels = {1, 1};
  others[4].exposure_us = 10001;
  others[5].gain = 1.0001;
  others[6].repeat_index = 1;
  others[7].axis_counts = {2, 1};
  others[8].laser_level = 1;
  others[9].laser_tilt_rad = 1e-9;
  for (size_t i = 0; i < others.size(); ++i) {
    EXPECT_NE(bytes, ReadOut(camera, Whole(camera), expected, others[i]).value()) << i;
  }
}

// A pixel's noise depends on its own key alone, not on what was drawn before it.
TEST(Sensor, PixelsAreIndependentOfEachOther) {
  const Camera camera = TestCamera(12);
  const NoiseKey key{.seed = 1, .camera_serial = "A", .axis_counts = {}, .lamp_levels = {}};
  std::vector<float> a(20000, 3000.f), b(a);
  for (size_t i = 0; i < 10000; ++i) b[i] = 1.f;
  const auto codes_a = Codes(camera, ReadOut(camera, Whole(camera), a, key).value());
  const auto codes_b = Codes(camera, ReadOut(camera, Whole(camera), b, key).value());
  for (size_t i = 10000; i < 20000; ++i) ASSERT_EQ(codes_a[i], codes_b[i]);
}

// The noise of a pixel is that of its place on the sensor, wherever the region begins.
TEST(Sensor, RegionIsTheCropOfTheWholeFrame) {
  for (int bits : {8, 12}) {
    const Camera camera = TestCamera(bits);
    std::vector<float> expected(20000);
    for (size_t i = 0; i < expected.size(); ++i) {
      expected[i] = i % 3 == 0 ? 0.f : static_cast<float>(i % 977);
    }
    const NoiseKey key{.seed = 1, .camera_serial = "A", .axis_counts = {}, .lamp_levels = {}};
    const std::string whole = ReadOut(camera, Whole(camera), expected, key).value();
    const size_t bytes = static_cast<size_t>(camera.bytes_per_pixel());
    for (const Region& region : {Region{2, 0, 4, 2}, {198, 98, 2, 2}, {14, 36, 130, 50}}) {
      std::vector<float> part;
      std::string crop;
      for (int j = region.y; j < region.y + region.height; ++j) {
        const auto from = static_cast<size_t>(200 * j + region.x);
        const auto width = static_cast<size_t>(region.width);
        part.insert(part.end(), expected.begin() + from, expected.begin() + from + width);
        crop += whole.substr(from * bytes, width * bytes);
      }
      EXPECT_EQ(ReadOut(camera, region, part, key).value(), crop);
    }
  }
}

TEST(Sensor, RefusesRegionsBeyondTheSensor) {
  const Camera camera = TestCamera(12);
  const std::vector<float> expected(4, 1.f);
  EXPECT_TRUE(ReadOut(camera, {198, 98, 2, 2}, expected, {}).ok());
  for (const Region& region : {Region{-2, 0, 2, 2}, {0, -2, 2, 2}, {200, 0, 2, 2}, {0, 100, 2, 2},
                               {2147483646, 0, 2, 2}, {0, 0, 0, 0}, {0, 0, 4, 2}}) {
    EXPECT_FALSE(ReadOut(camera, region, expected, {}).ok());
  }
}

// Repeats are independent: averaging n of them lowers the noise by sqrt(n).
TEST(Sensor, AveragingRepeatsHelps) {
  const Camera camera = TestCamera(12);
  const std::vector<float> expected(20000, 2000.f);
  std::vector<double> mean(20000);
  double single = 0;
  for (uint32_t repeat = 0; repeat < 16; ++repeat) {
    const NoiseKey key{.seed = 9, .camera_serial = "A", .axis_counts = {}, .lamp_levels = {},
                       .repeat_index = repeat};
    const auto codes = Codes(camera, ReadOut(camera, Whole(camera), expected, key).value());
    for (size_t i = 0; i < 20000; ++i) mean[i] += codes[i] / 16;
    if (repeat == 0) single = MomentsOf(codes).variance;
  }
  EXPECT_NEAR(single / MomentsOf(mean).variance, 16, 1.5);
}

TEST(Sensor, RefusesWhatIsNoLight) {
  const Camera camera = TestCamera(12);
  std::vector<float> expected(20000, 1.f);
  EXPECT_FALSE(ReadOut(camera, Whole(camera), std::span(expected).first(10), {}).ok());
  NoiseKey key;
  for (double gain : {0.0, -1.0, std::nan("")}) {
    key.gain = gain;
    EXPECT_FALSE(ReadOut(camera, Whole(camera), expected, key).ok());
  }
  expected[5] = -1;
  EXPECT_FALSE(ReadOut(camera, Whole(camera), expected, {}).ok());
  expected[5] = std::nanf("");
  EXPECT_FALSE(ReadOut(camera, Whole(camera), expected, {}).ok());
}

}  // namespace
}  // namespace mesorig::plant
