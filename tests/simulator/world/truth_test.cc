#include "simulator/world/truth.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "simulator/world/sample.h"
#include "simulator/world/strata.h"
#include "tests/simulator/world/test_surfaces.h"

namespace mesorig::world {
namespace {

btf::BtfHeader Header(std::vector<Vec3> views, std::vector<Vec3> lights) {
  btf::BtfHeader header;
  header.width = 6;
  header.height = 4;
  header.pitch_mm = 2;
  header.h_ref_mm = 3;
  header.views = std::move(views);
  header.lights = std::move(lights);
  return header;
}

std::vector<uint8_t> All(const btf::BtfHeader& header) {
  return std::vector<uint8_t>(header.views.size() * header.lights.size(), 1);
}

Truth Compute(const World& world, const btf::BtfHeader& header, TruthOptions options = {}) {
  return ComputeTruth(world, header, All(header), options).value();
}

std::vector<Vec3> SomeDirections() {
  std::vector<Vec3> directions;
  for (double t : {0.0, 20.0, 50.0, 75.0}) {
    directions.push_back(DirectionFromAngles(RadFromDeg(t), t));
  }
  return directions;
}

// rho / pi cos(theta_l), whatever the view; no noise on a plane.
TEST(Truth, LambertPlaneFarAway) {
  const auto world = Build(Plane(1, Lambert(0.9, 0.6, 0.3)));
  const btf::BtfHeader header = Header(SomeDirections(), SomeDirections());
  const Truth truth = Compute(*world, header);
  for (int v = 0; v < 4; ++v) {
    for (int l = 0; l < 4; ++l) {
      const auto image = truth.btf.Image(v, l);
      for (size_t i = 0; i < image.size(); ++i) {
        const double rho = 0.9 - 0.3 * static_cast<double>(i % 3);
        ASSERT_NEAR(image[i], rho / kPi * header.lights[l].z, 2e-6) << v << " " << l;
      }
    }
  }
  ASSERT_TRUE(truth.standard_error);
  EXPECT_LT(*truth.standard_error, 1e-6);
}

// Near lamp, near camera, one ray a texel: the ray through the texel's centre (x, y, 3) meets the
// plane z = 1 at p - v (3 - 1) / v.z; the lamp stands at P. value = rho/pi cos d_ref^2 / d_hit^2.
TEST(Truth, LambertPlaneNearby) {
  const auto world = Build(Plane(1, Lambert(0.5, 0.5, 0.5)));
  btf::BtfHeader header = Header({DirectionFromAngles(1, 0)}, {DirectionFromAngles(0.8, 2)});
  header.view_positions_mm = {200 * header.views[0]};
  header.light_positions_mm = {100 * header.lights[0]};
  TruthOptions options;
  options.strata = 1;
  const Truth truth = Compute(*world, header, options);
  EXPECT_FALSE(truth.standard_error);
  for (int j = 0; j < 4; ++j) {
    for (int i = 0; i < 6; ++i) {
      const Vec3 p{(i - 2.5) * 2, (1.5 - j) * 2, 3};
      const Vec3 v = Normalized(header.view_positions_mm[0] - p);
      const Vec3 hit = p - (2 / v.z) * v;
      const Vec3 to_hit = header.light_positions_mm[0] - hit;
      const Vec3 to_texel = header.light_positions_mm[0] - p;
      const double expected = 0.5 / kPi * (to_hit.z / Norm(to_hit)) * Dot(to_texel, to_texel) /
                              Dot(to_hit, to_hit);
      EXPECT_NEAR(truth.btf.Image(0, 0)[3 * (6 * j + i)], expected, 2e-6);
    }
  }
  options.nominal = true;
  const Truth nominal = Compute(*world, header, options);
  EXPECT_TRUE(nominal.btf.header().view_positions_mm.empty());
  EXPECT_NEAR(nominal.btf.Image(0, 0)[0], 0.5 / kPi * header.lights[0].z, 2e-6);
}

// A texel that is half in the shadow of a wall gets half the light: the value is an area average.
TEST(Truth, AveragesOverTheFootprint) {
  Surface surface = Plane(0, Lambert(1, 1, 1));
  surface.material = [](double x, double) { return x < 0.5 ? Lambert(1, 1, 1) : Lambert(0, 0, 0); };
  const auto world = Build(surface);
  btf::BtfHeader header = Header({{0, 0, 1}}, {{0, 0, 1}});
  TruthOptions options;
  options.strata = 8;
  // Texel i = 3 spans x from 0 to 2: a quarter of it is white.
  EXPECT_NEAR(Compute(*world, header, options).btf.Image(0, 0)[3 * 3], 0.25 / kPi, 1e-6);
}

TEST(Strata, OneInEachCellColumnAndRow) {
  for (int n : {1, 2, 3, 4, 7}) {
    std::vector<int> cells(n * n), columns(n * n), rows(n * n);
    double mean_u = 0, mean_v = 0;
    for (int s = 0; s < n * n; ++s) {
      const auto [u, v] = StratumPoint(s, n);
      ++cells[static_cast<int>(u * n) + n * static_cast<int>(v * n)];
      ++columns[static_cast<int>(u * n * n)];
      ++rows[static_cast<int>(v * n * n)];
      mean_u += u / (n * n), mean_v += v / (n * n);
    }
    EXPECT_THAT(cells, testing::Each(1));
    EXPECT_THAT(columns, testing::Each(1));
    EXPECT_THAT(rows, testing::Each(1));
    EXPECT_NEAR(mean_u, 0.5, 1e-12);
    EXPECT_NEAR(mean_v, 0.5, 1e-12);
  }
}

TEST(Truth, AbsentStaysAbsentAndThreadsDoNotMatter) {
  const std::string path = std::string(MESORIG_SOURCE_DIR) + "/rigs/samples/weave.toml";
  Surface surface = LoadSample(path).value().surface;
  surface.grid_mm = 0.3;
  const auto world = Build(surface);
  btf::BtfHeader header = Header(SomeDirections(), SomeDirections());
  header.h_ref_mm = 4.2;
  std::vector<uint8_t> present = All(header);
  present[5] = 0;
  TruthOptions one, two;
  one.threads = 1, two.threads = 2;
  const Truth a = ComputeTruth(*world, header, present, one).value();
  const Truth b = ComputeTruth(*world, header, present, two).value();
  EXPECT_FALSE(a.btf.Present(1, 1));
  EXPECT_EQ(a.btf.present_count(), 15u);
  for (int v = 0; v < 4; ++v) {
    for (int l = 0; l < 4; ++l) {
      EXPECT_THAT(a.btf.Image(v, l), testing::ElementsAreArray(b.btf.Image(v, l)));
    }
  }
  EXPECT_EQ(a.standard_error, b.standard_error);
}

// The stated standard error bounds the error against many more rays.
TEST(Truth, StandardErrorIsHonest) {
  const std::string path = std::string(MESORIG_SOURCE_DIR) + "/rigs/samples/weave.toml";
  const auto world = Build(LoadSample(path).value().surface);
  btf::BtfHeader header = Header({DirectionFromAngles(0.5, 1)}, {DirectionFromAngles(0.9, 4)});
  header.width = header.height = 32;
  header.pitch_mm = 0.5;
  header.h_ref_mm = 4.2;
  TruthOptions coarse, fine;
  coarse.strata = 4;
  fine.strata = 24;
  const Truth a = Compute(*world, header, coarse), b = Compute(*world, header, fine);
  double squared = 0;
  for (size_t i = 0; i < a.btf.image_size(); ++i) {
    squared += std::pow(a.btf.Image(0, 0)[i] - b.btf.Image(0, 0)[i], 2);
  }
  const double rms = std::sqrt(squared / static_cast<double>(a.btf.image_size()));
  EXPECT_LT(rms, *a.standard_error);
  EXPECT_GT(rms, 0.02 * *a.standard_error);
  EXPECT_LT(*b.standard_error, *a.standard_error);
}

TEST(Truth, RefusesWhatItCannotCompute) {
  const auto world = Build(Plane(1, Lambert(0.5, 0.5, 0.5)));
  const auto refused = [&](const btf::BtfHeader& header, TruthOptions options = {}) {
    return ComputeTruth(*world, header, All(header), options).status().code() ==
           absl::StatusCode::kInvalidArgument;
  };
  const btf::BtfHeader good = Header(SomeDirections(), SomeDirections());
  btf::BtfHeader header = good;
  header.h_ref_mm = 0.5;
  EXPECT_TRUE(refused(header));
  header = good, header.pitch_mm = 0;
  EXPECT_TRUE(refused(header));
  header = good, header.calibrated = false;
  EXPECT_TRUE(refused(header));
  header = good, header.views[1] = {1, 0, 0};
  EXPECT_TRUE(refused(header));
  TruthOptions options;
  options.strata = 0;
  EXPECT_TRUE(refused(good, options));
  EXPECT_FALSE(ComputeTruth(*world, good, {1, 1}, {}).ok());
}

}  // namespace
}  // namespace mesorig::world
