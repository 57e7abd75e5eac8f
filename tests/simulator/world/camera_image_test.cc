#include "simulator/world/camera_image.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "simulator/plant/sensor.h"
#include "simulator/world/weave.h"
#include "tests/simulator/world/test_surfaces.h"

namespace mesorig::world {
namespace {

Rig Demo() { return LoadRig(std::string(MESORIG_SOURCE_DIR) + "/rigs/demo.toml").value(); }

// Turntable at 60, light arc at 90 degrees.
RigState State(const Rig& rig, int lamp, double level = 1) {
  RigState state{{RadFromDeg(60), RadFromDeg(90)}, std::vector<double>(rig.lamps.size(), 0.0)};
  state.lamp_levels[static_cast<size_t>(lamp)] = level;
  return state;
}

// Radiance of a Lambert plane at height z in pixel (i, j), by hand: rho/pi cos(theta) I/d^2.
double PlaneElectrons(const Rig& rig, int camera, int lamp, double z, double rho, int i, int j,
                      double exposure_s) {
  const std::vector<double> axes = {RadFromDeg(60), RadFromDeg(90)};
  const Camera& c = rig.cameras[camera];
  const RigidTransform pose = SampleFromCamera(rig, camera, axes);
  const Vec3 d = pose.rotation * RayDirection(c, {i + 0.5, j + 0.5});
  const Vec3 p = pose.translation + ((z - pose.translation.z) / d.z) * d;
  const Vec3 to_lamp = LampInSample(rig, lamp, axes) - p;
  const double distance_m = Norm(to_lamp) / 1000;
  const double irradiance = rig.lamps[lamp].intensity_w_sr[ChannelOfPixel(c, i, j)] *
                            (to_lamp.z / Norm(to_lamp)) / (distance_m * distance_m);
  return rho / kPi * irradiance * c.electrons_per_radiance_s * exposure_s;
}

TEST(CameraImage, LambertPlaneIsExact) {
  const Rig rig = Demo();
  const auto world = Build(Plane(1, Lambert(0.8, 0.5, 0.2), 80));
  CameraImages images(rig, *world, {});
  for (int camera : {0, 4, 7}) {
    for (int lamp : {0, 4, 7}) {
      const auto electrons = images.ExpectedElectrons(camera, State(rig, lamp), 0.02).value();
      for (auto [i, j] : {std::pair{128, 96}, {101, 90}, {160, 111}, {129, 97}, {128, 97}}) {
        const double rho = 0.8 - 0.3 * ChannelOfPixel(rig.cameras[camera], i, j);
        const double expected = PlaneElectrons(rig, camera, lamp, 1, rho, i, j, 0.02);
        EXPECT_NEAR(electrons[256 * j + i] / expected, 1, 2e-4) << camera << " " << lamp;
      }
    }
  }
}

// Through the sensor: the mean over a patch is the radiance, within the noise of the patch.
TEST(CameraImage, LambertPlaneThroughTheSensor) {
  const Rig rig = Demo();
  const auto world = Build(Plane(1, Lambert(0.5, 0.5, 0.5), 80));
  CameraImages images(rig, *world, {});
  const Camera& c = rig.cameras[3];
  const auto expected = images.ExpectedElectrons(3, State(rig, 2), 0.02).value();
  plant::NoiseKey key{.seed = 5, .camera_serial = c.serial, .axis_counts = {60000, 90000},
                      .lamp_levels = {}, .exposure_us = 20000};
  const std::string bytes = plant::ReadOut(c, {0, 0, c.width, c.height}, expected, key).value();
  double sum = 0, expected_sum = 0, variance = 0;
  for (int j = 76; j < 116; j += 2) {
    for (int i = 108; i < 148; i += 2) {  // red pixels
      const size_t at = 2 * static_cast<size_t>(256 * j + i);
      const double dn = static_cast<unsigned char>(bytes[at]) +
                        256.0 * static_cast<unsigned char>(bytes[at + 1]);
      sum += (dn - c.black_dn) * c.full_well_e / (c.white_dn() - c.black_dn);
      const double e = PlaneElectrons(rig, 3, 2, 1, 0.5, i, j, 0.02);
      expected_sum += e;
      variance += e + c.read_noise_e * c.read_noise_e + 25 / 12.0;
    }
  }
  EXPECT_NEAR(sum, expected_sum, 4 * std::sqrt(variance));
  EXPECT_LT(4 * std::sqrt(variance) / expected_sum, 0.005);
}

TEST(CameraImage, LightAddsUpAndScales) {
  const Rig rig = Demo();
  const auto world = Build(Plane(1, Lambert(0.5, 0.5, 0.5), 80));
  CameraImages images(rig, *world, {});
  RigState both = State(rig, 1);
  both.lamp_levels[6] = 0.25;
  const auto one = images.ExpectedElectrons(2, State(rig, 1), 0.02).value();
  const auto six = images.ExpectedElectrons(2, State(rig, 6), 0.02).value();
  const auto sum = images.ExpectedElectrons(2, both, 0.04).value();
  for (size_t i = 0; i < sum.size(); i += 101) {
    EXPECT_NEAR(sum[i], 2 * one[i] + 0.5 * six[i], 1e-3 * sum[i]);
  }
  RigState dark = State(rig, 0, 0);
  EXPECT_THAT(images.ExpectedElectrons(2, dark, 0.02).value(), testing::Each(0.f));
}

// Kept first hits and pictures change nothing, neither does the number of threads.
TEST(CameraImage, CachesAndThreadsDoNotMatter) {
  const Rig rig = Demo();
  const auto world = Build(Plane(1, Lambert(0.5, 0.5, 0.5), 80));
  ImageOptions small;
  small.threads = 1;
  small.cache_bytes = 0;
  CameraImages large(rig, *world, {}), forgetful(rig, *world, small);
  for (int round = 0; round < 2; ++round) {
    for (int camera : {1, 5}) {
      for (int lamp = 0; lamp < 8; ++lamp) {
        EXPECT_EQ(large.ExpectedElectrons(camera, State(rig, lamp), 0.02).value(),
                  forgetful.ExpectedElectrons(camera, State(rig, lamp), 0.02).value());
      }
    }
  }
}

// The letter F alone is white. cam0 looks down with +y to the right and +x down (see rig_geometry's
// golden test), the turntable at 0: (x, y, 3.3) is seen at u = 128 + 2600 y / 796.7,
// v = 96 + 2600 x / 796.7.
TEST(CameraImage, LetterIsSeenUnmirrored) {
  const Rig rig = Demo();
  WeaveShape shape;
  shape.letter_x_mm = 1;
  Surface surface = Plane(0, {}, 60);
  surface.grid_mm = 0.2;
  surface.height_mm = [shape](double x, double y) { return 3.3 * LetterCoverage(shape, x, y); };
  surface.material = [shape](double x, double y) {
    const double rho = LetterCoverage(shape, x, y) > 0.99 ? 0.8 : 0.0;
    return Lambert(rho, rho, rho);
  };
  const auto world = Build(surface);
  CameraImages images(rig, *world, {});
  RigState state = State(rig, 0);
  state.axis_rad = {0, RadFromDeg(90)};
  const auto electrons = images.ExpectedElectrons(0, state, 0.02).value();
  const auto at = [&](int u, int v) { return electrons[static_cast<size_t>(256 * v + u)]; };
  // (-4, -10): u = 128 - 32.6, v = 96 - 13.1. (6.5, 9.5): u = 128 + 31.0, v = 96 + 21.2.
  EXPECT_GT(at(95, 83), 1000);
  EXPECT_GT(at(159, 117), 1000);
  // (4, -1): u = 128 - 3.3, v = 96 + 13.1.
  EXPECT_GT(at(124, 109), 1000);
  // (6.5, -9.5), where the F has nothing: u = 128 - 31.0, v = 96 + 21.2.
  EXPECT_EQ(at(97, 117), 0);
  EXPECT_EQ(at(97, 109), 0);
}

TEST(CameraImage, SolidsHide) {
  const Rig rig = Demo();
  const auto world = Build(Plane(1, Lambert(0.5, 0.5, 0.5), 80));
  CameraImages images(rig, *world, {});
  RigState state = State(rig, 1);
  state.axis_rad = {0, 0};  // the light arc stands before the cameras
  EXPECT_THAT(images.ExpectedElectrons(4, state, 0.02).value(), testing::Each(0.f));
}

TEST(CameraImage, RefusesWhatTheRigHasNot) {
  const Rig rig = Demo();
  const auto world = Build(Plane(1, Lambert(0.5, 0.5, 0.5), 80));
  CameraImages images(rig, *world, {});
  EXPECT_FALSE(images.ExpectedElectrons(8, State(rig, 0), 0.02).ok());
  EXPECT_FALSE(images.ExpectedElectrons(-1, State(rig, 0), 0.02).ok());
  EXPECT_FALSE(images.ExpectedElectrons(0, State(rig, 0, 1.5), 0.02).ok());
  EXPECT_FALSE(images.ExpectedElectrons(0, State(rig, 0, std::nan("")), 0.02).ok());
  EXPECT_FALSE(images.ExpectedElectrons(0, State(rig, 0), -1).ok());
  RigState state = State(rig, 0);
  state.axis_rad[0] = std::nan("");
  EXPECT_FALSE(images.ExpectedElectrons(0, state, 0.02).ok());
  state.axis_rad.pop_back();
  EXPECT_FALSE(images.ExpectedElectrons(0, state, 0.02).ok());
}

}  // namespace
}  // namespace mesorig::world
