// The line laser as cameras see it, against numbers computed by hand. Turntable at 0, light arc at
// 90 degrees unless said: the source stands at y > 0, the stripe runs along x. Camera 0 looks down
// from 800 mm with u along y and v along x, 2600 pixels of focal length, (128, 96) in the middle.

#include <gtest/gtest.h>

#include <cmath>

#include "simulator/world/camera_image.h"
#include "tests/simulator/world/test_surfaces.h"

namespace mesorig::world {
namespace {

constexpr int kZenith = 0, kSlant = 1;

Rig Demo() { return LoadRig(std::string(MESORIG_SOURCE_DIR) + "/rigs/demo.toml").value(); }

RigState Lit(const Rig& rig, int mount, double tilt_rad, double arc_deg = 90) {
  return {
      {0, RadFromDeg(arc_deg)}, std::vector<double>(rig.lamps.size(), 0.0), {mount, 1, tilt_rad}};
}

double At(const Rig& rig, const std::vector<float>& electrons, int camera, const RigState& state,
          Vec3 p) {
  const auto at =
      Project(rig.cameras[camera], Inverse(SampleFromCamera(rig, camera, state.axis_rad)) * p);
  int i = static_cast<int>(at->u);
  const int j = static_cast<int>(at->v);
  i += ChannelOfPixel(rig.cameras[camera], i, j) == 1 ? 0 : 1;  // the green pixel beside
  return electrons.at(static_cast<size_t>(256 * j + i));
}

double TiltAt(const Rig& rig, const RigState& state, Vec3 p) {
  return TiltOfPoint(LaserInSample(rig, state.laser.mount, state.axis_rad), p);
}

struct Profile {
  double sum = 0, centre = 0, peak = 0;
};
// Of the pixels of one channel in a row.
Profile RowProfile(const std::vector<float>& electrons, int row, int first) {
  Profile profile;
  for (int i = first; i < 256; i += 2) {
    const double e = electrons[static_cast<size_t>(256 * row + i)];
    profile.sum += e;
    profile.centre += e * (i + 0.5);
    profile.peak = std::max(profile.peak, e);
  }
  profile.centre /= profile.sum;
  return profile;
}

// A Lambert plane (albedo 0.5) at z = 3 mm, the source at 35 degrees and 640 mm, tilt 0: the sheet
// through the origin meets it at y = 3 tan 35 = 2.1006, r = 640 - 3 / cos 35 = 636.338 from the
// source, seen at u = 128 + 2600 * 2.1006 / 797 = 134.853. Along the stripe 0.08 W / (1.047198 *
// 636.338 mm) = 1.20053e-4 W/mm, whatever the angle, so that the radiance summed across is 0.5 / pi
// * 1.20053e-4 * 1e6 = 19.107 W m^-2 sr^-1 mm. A green pixel every 2 * 797 / 2600 mm and 800
// electrons per W m^-2 sr^-1 (20 ms): 24932 electrons in a row. Peak: 19.107 * cos 35 / (1.01918
// * 2.50663) = 6.1266, 4901 electrons.
TEST(LaserImage, StripeOnAPlane) {
  const Rig rig = Demo();
  const auto world = Build(Plane(3, Lambert(0.5, 0.5, 0.5), 58));
  CameraImages images(rig, *world, {});
  const auto electrons = images.ExpectedElectrons(0, Lit(rig, kSlant, 0), 0.02).value();
  const Profile green = RowProfile(electrons, 96, 1), red = RowProfile(electrons, 96, 0);
  EXPECT_NEAR(green.centre, 134.853, 0.02);
  EXPECT_NEAR(green.sum / 24932, 1, 2e-3);
  EXPECT_NEAR(green.peak / 4901, 1, 0.02) << "the pixel in the middle averages over 0.3 mm";
  EXPECT_NEAR(red.sum / green.sum, 0.15, 1e-4) << "the laser is green";
}

// At z = 0 the stripe lies at x(t) = d sin(theta) - d cos(theta) tan(theta + t): for the zenith
// mount and a tilt of 1 degree, 55.780 - 637.565 * tan 6 deg = -11.231: u = 128 - 2600 * 11.231 /
// 800 = 91.50. The turntable's albedo is 0.3.
TEST(LaserImage, StripeOnTheTurntableBesideTheSample) {
  const Rig rig = Demo();
  const auto world = Build(Plane(2, Lambert(0.5, 0.5, 0.5), 10));
  CameraImages images(rig, *world, {});
  const RigState state = Lit(rig, kZenith, RadFromDeg(1));
  const auto electrons = images.ExpectedElectrons(0, state, 0.02).value();
  for (int row : {20, 170}) {
    const Profile green = RowProfile(electrons, row, row % 2 == 0 ? 1 : 0);
    EXPECT_NEAR(green.centre, 91.50, 0.02) << row;
    // 0.3 / pi * 0.08 / (1.047198 r) * 1e6 * 800 / (2 * 800 / 2600), r about 641.1 (tilted by one
    // degree, 11 mm aside) and some 25 mm along the stripe: 641.6.
    EXPECT_NEAR(green.sum / 14781, 1, 3e-3) << row;
  }
}

TEST(LaserImage, LampsLeaveTheTurntableBlack) {
  const Rig rig = Demo();
  const auto world = Build(Plane(2, Lambert(0.5, 0.5, 0.5), 10));
  CameraImages images(rig, *world, {});
  RigState state = Lit(rig, kZenith, 0);
  state.laser.level = 0;
  state.lamp_levels[2] = 1;
  const auto lamp = images.ExpectedElectrons(0, state, 0.02).value();
  EXPECT_GT(At(rig, lamp, 0, state, {0, 0, 2}), 1000);
  EXPECT_EQ(At(rig, lamp, 0, state, {20, 0, 0}), 0);
  // Both at once add up.
  state.laser.level = 0.5;
  const auto both = images.ExpectedElectrons(0, state, 0.02).value();
  state.lamp_levels[2] = 0;
  const auto half = images.ExpectedElectrons(0, state, 0.02).value();
  const auto full = images.ExpectedElectrons(0, Lit(rig, kZenith, 0), 0.02).value();
  for (size_t i = 0; i < both.size(); i += 37) {
    ASSERT_NEAR(both[i], lamp[i] + half[i], 1e-3 * both[i] + 1e-3);
    ASSERT_NEAR(half[i], 0.5 * full[i], 1e-3 * half[i] + 1e-3);
  }
}

TEST(LaserImage, TurntableEndsAtItsRadius) {
  const Rig rig = Demo();
  const auto world = Build(Plane(2, Lambert(0.5, 0.5, 0.5), 10));
  CameraImages images(rig, *world, {});
  const RigState state = Lit(rig, kZenith, 0);
  const auto electrons = images.ExpectedElectrons(7, state, 0.02).value();
  EXPECT_GT(At(rig, electrons, 7, state, {-57, 0, 0}), 500);
  EXPECT_EQ(At(rig, electrons, 7, state, {-63, 0, 0}), 0);
}

TEST(LaserImage, OutsideTheFanIsDark) {
  Rig rig = Demo();
  rig.laser->fan_rad = RadFromDeg(4);  // 640 tan 2 deg = 22.3 mm to both sides
  const auto world = Build(Plane(0, Lambert(0.5, 0.5, 0.5), 58));
  CameraImages images(rig, *world, {});
  const RigState state = Lit(rig, kZenith, 0);
  const auto electrons = images.ExpectedElectrons(0, state, 0.02).value();
  EXPECT_GT(At(rig, electrons, 0, state, {21.5, 0, 0}), 1000);
  EXPECT_GT(At(rig, electrons, 0, state, {-21.5, 0, 0}), 1000);
  EXPECT_EQ(At(rig, electrons, 0, state, {23.2, 0, 0}), 0);
  EXPECT_EQ(At(rig, electrons, 0, state, {-23.2, 0, 0}), 0);
}

// A wall of 5 mm at x = 0, the source beyond it at 35 degrees: 5 tan 35 = 3.5 mm of the ground lie
// in its shadow.
TEST(LaserImage, WallsThrowShadows) {
  const Rig rig = Demo();
  const auto world = Build(Step(5, 0.05));
  CameraImages images(rig, *world, {});
  RigState state = Lit(rig, kSlant, 0, 180);
  for (double x : {0.6, 1.5, 3.0}) {
    state.laser.tilt_rad = TiltAt(rig, state, {x, 0, 0});
    const auto electrons = images.ExpectedElectrons(0, state, 0.02).value();
    EXPECT_EQ(At(rig, electrons, 0, state, {x, 0, 0}), 0) << x;
  }
  for (double x : {4.2, 8.0}) {
    state.laser.tilt_rad = TiltAt(rig, state, {x, 0, 0});
    const auto electrons = images.ExpectedElectrons(0, state, 0.02).value();
    EXPECT_GT(At(rig, electrons, 0, state, {x, 0, 0}), 4000) << x;
  }
  state.laser.tilt_rad = TiltAt(rig, state, {-4, 0, 5});
  const auto electrons = images.ExpectedElectrons(0, state, 0.02).value();
  EXPECT_GT(At(rig, electrons, 0, state, {-4, 0, 5}), 4000) << "on top of it";
}

// Of 197,000 hits one picture lights those within four sigma (4.1 mm of 59 mm, to both sides), a
// second one of the same sheet none, and a whole sweep each once at most.
TEST(LaserImage, OnlyHitsNearTheSheetAreLit) {
  const Rig rig = Demo();
  const auto world = Build(Plane(2, Lambert(0.5, 0.5, 0.5), 58));
  CameraImages images(rig, *world, {});
  constexpr uint64_t kAll = 256 * 192 * 4;
  ASSERT_TRUE(images.ExpectedElectrons(0, Lit(rig, kSlant, 0, 0), 0.02).ok());
  const uint64_t one = images.laser_hits_lit();
  EXPECT_GT(one, kAll / 8);
  EXPECT_LT(one, kAll / 4);
  ASSERT_TRUE(images.ExpectedElectrons(0, Lit(rig, kSlant, 0, 0), 0.02).ok());
  EXPECT_EQ(images.laser_hits_lit(), one);
  for (int i = -32; i <= 32; ++i) {
    ASSERT_TRUE(images.ExpectedElectrons(0, Lit(rig, kSlant, 0.0015 * i, 0), 0.02).ok());
  }
  EXPECT_LE(images.laser_hits_lit(), kAll);
  EXPECT_GT(images.laser_hits_lit(), kAll * 9 / 10);
}

// What was lit before, and in which order, changes no byte.
TEST(LaserImage, PicturesDoNotDependOnHistory) {
  const Rig rig = Demo();
  const auto world = Build(Step(3, 0.2));
  CameraImages fresh(rig, *world, {}), used(rig, *world, {});
  for (int i : {7, -3, 12, 0, 5}) {
    ASSERT_TRUE(used.ExpectedElectrons(3, Lit(rig, kSlant, 0.002 * i), 0.02).ok());
  }
  ASSERT_TRUE(used.ExpectedElectrons(3, Lit(rig, kZenith, 0.001), 0.02).ok());
  const RigState state = Lit(rig, kSlant, 0.003);
  EXPECT_EQ(used.ExpectedElectrons(3, state, 0.02).value(),
            fresh.ExpectedElectrons(3, state, 0.02).value());
}

TEST(LaserImage, RegionIsTheCrop) {
  const Rig rig = Demo();
  const auto world = Build(Plane(2, Lambert(0.5, 0.5, 0.5), 30));
  CameraImages images(rig, *world, {});
  RigState state = Lit(rig, kSlant, 0.005);
  state.lamp_levels[1] = 0.1;
  const Region region{100, 40, 90, 102};
  const auto whole = images.ExpectedElectrons(2, state, 0.02).value();
  const auto part = images.ExpectedElectrons(2, state, 0.02, region).value();
  ASSERT_EQ(part.size(), 90u * 102u);
  for (int j = 0; j < 102; ++j) {
    for (int i = 0; i < 90; ++i) {
      ASSERT_EQ(part[static_cast<size_t>(90 * j + i)],
                whole[static_cast<size_t>(256 * (40 + j) + 100 + i)]);
    }
  }
  EXPECT_FALSE(images.ExpectedElectrons(2, state, 0.02, Region{200, 0, 58, 10}).ok());
}

// Upwards, sideways, all the way round: dark or the same, never a NaN.
TEST(LaserImage, AnyTilt) {
  const Rig rig = Demo();
  const auto world = Build(Plane(2, Lambert(0.5, 0.5, 0.5), 30));
  CameraImages images(rig, *world, {});
  for (double tilt : {kPi / 2, -kPi / 2, kPi, -kPi, 1.0, 1e9}) {
    const auto electrons = images.ExpectedElectrons(1, Lit(rig, kSlant, tilt), 0.02).value();
    for (float e : electrons) ASSERT_EQ(e, 0) << tilt;
  }
  const auto once = images.ExpectedElectrons(1, Lit(rig, kSlant, 0.01), 0.02).value();
  const auto again = images.ExpectedElectrons(1, Lit(rig, kSlant, 0.01 + 2 * kPi), 0.02).value();
  for (size_t i = 0; i < once.size(); ++i) ASSERT_NEAR(once[i], again[i], 1e-2 + 1e-3 * once[i]);
}

TEST(LaserImage, RefusesWhatTheRigHasNot) {
  Rig rig = Demo();
  const auto world = Build(Plane(2, Lambert(0.5, 0.5, 0.5), 30));
  CameraImages images(rig, *world, {});
  EXPECT_FALSE(images.ExpectedElectrons(0, Lit(rig, 2, 0), 0.02).ok());
  EXPECT_FALSE(images.ExpectedElectrons(0, Lit(rig, -1, 0), 0.02).ok());
  EXPECT_FALSE(images.ExpectedElectrons(0, Lit(rig, 0, std::nan("")), 0.02).ok());
  for (double level : {-0.1, 1.5, std::nan("")}) {
    RigState state = Lit(rig, 0, 0);
    state.laser.level = level;
    EXPECT_FALSE(images.ExpectedElectrons(0, state, 0.02).ok()) << level;
  }
  rig.laser.reset();
  EXPECT_FALSE(images.ExpectedElectrons(0, Lit(rig, 0, 0), 0.02).ok());
}

}  // namespace
}  // namespace mesorig::world
