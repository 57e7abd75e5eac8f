#include "simulator/world/mdf_truth.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <sstream>
#include <string>

#include "protocol/base/file_writer.h"
#include "simulator/world/sample.h"
#include "tests/simulator/world/test_surfaces.h"

namespace mesorig::world {
namespace {

btf::MdfHeader Header(std::vector<Vec3> views) {
  btf::MdfHeader header;
  header.width = 20;
  header.height = 10;
  header.pitch_mm = 1;
  header.h_ref_mm = 5;
  header.views = std::move(views);
  return header;
}

Vec3 View(double theta_deg, double phi_deg) {
  return DirectionFromAngles(RadFromDeg(theta_deg), RadFromDeg(phi_deg));
}

// D = (h_ref - z) / v.z: 3.5, and 3.5 / cos 60 = 7.
TEST(MdfTruth, FlatPlane) {
  const auto world = Build(Plane(1.5, Lambert(0.5, 0.5, 0.5), 60));
  const MdfTruth truth = ComputeMdfTruth(*world, Header({View(0, 0), View(60, 200)}), 2).value();
  for (size_t i = 0; i < 200; ++i) {
    ASSERT_NEAR(truth.mdf.Distance(0)[i], 3.5, 1e-5);
    ASSERT_NEAR(truth.mdf.Distance(1)[i], 7.0, 1e-5);
    ASSERT_EQ(truth.mdf.Confidence(0)[i], 1);
  }
  EXPECT_EQ(truth.missed, 0u);
}

// A wall of 2 mm at x = 0, high for x < 0 (it rises over the cell from 0 to -0.05), h_ref = 5, seen
// from +x at 45 degrees: the ray from p goes by -x. Texel i lies at x = i - 9.5, row 4 at y = 0.5.
// x = 6.5: meets z = 0 at x = 1.5; D = 5 sqrt 2 = 7.0711.  x = 4.5: would meet z = 0 at x = -0.5,
// so that it meets the wall at x = 0 .. -0.05, 4.5 to 4.55 away in x: D = 6.36 .. 6.43. x = -2.5:
// the top, D = 3 sqrt 2 = 4.2426. From -x (phi 180) x = -4.5 goes to +x and meets the top at x =
// -1.5; x = -2.5 passes the edge at height 2.5 and meets the ground at x = 2.5.
TEST(MdfTruth, StepSeenFromBothSides) {
  const auto world = Build(Step(2, 0.05));
  const MdfTruth truth = ComputeMdfTruth(*world, Header({View(45, 0), View(45, 180)}), 1).value();
  const auto at = [&](int view, double x) {
    return truth.mdf.Distance(view)[static_cast<size_t>(4 * 20 + std::lround(x + 9.5))];
  };
  EXPECT_NEAR(at(0, 6.5), 7.0711, 1e-3);
  EXPECT_NEAR(at(0, 4.5), 6.40, 0.05);
  EXPECT_NEAR(at(0, -2.5), 4.2426, 1e-3);
  EXPECT_NEAR(at(1, -4.5), 4.2426, 1e-3);
  EXPECT_NEAR(at(1, -2.5), 7.0711, 1e-3);
}

// The weave's raised letter, from above: the stem of the F stands left of its middle, the bars to
// the right. Row 0 is at +y. Stem at x = -4, below the bars (y = -8): 3.2 mm or so high; nothing so
// high and even at x = +8.
TEST(MdfTruth, LetterStandsUnmirrored) {
  const auto sample =
      LoadSample(std::string(MESORIG_SOURCE_DIR) + "/rigs/samples/weave.toml").value();
  const auto world = Build(sample.surface);
  btf::MdfHeader header = Header({Vec3{0, 0, 1}});
  header.width = header.height = 40;
  header.h_ref_mm = 4.2;
  const MdfTruth truth = ComputeMdfTruth(*world, header, 2).value();
  const auto mean = [&](double x0, double x1, double y0, double y1) {
    double sum = 0;
    int n = 0;
    for (int j = 0; j < 40; ++j) {
      for (int i = 0; i < 40; ++i) {
        const Vec3 p = header.TexelCentre(i, j);
        if (p.x < x0 || p.x > x1 || p.y < y0 || p.y > y1) continue;
        sum += truth.mdf.Distance(0)[static_cast<size_t>(40 * j + i)];
        ++n;
      }
    }
    return sum / n;
  };
  EXPECT_LT(mean(-6, -2, -11, 11), 1.4) << "the stem";
  EXPECT_LT(mean(-2, 8, 8, 11.5), 1.4) << "the upper bar";
  EXPECT_GT(mean(2, 8, -11, -4), 1.5) << "right of the stem, below the bars: the weave";
}

// Past the rim the ray ends on the turntable: D = 5 / cos 70, and nothing of the sample is met.
TEST(MdfTruth, RaysPastTheSampleEndOnTheTurntable) {
  const auto world = Build(Plane(1, Lambert(0.5, 0.5, 0.5), 20));
  const MdfTruth truth = ComputeMdfTruth(*world, Header({View(70, 0)}), 1).value();
  const size_t row = 5 * 20;
  EXPECT_NEAR(truth.mdf.Distance(0)[row], 5 / std::cos(RadFromDeg(70)), 1e-4) << "x = -9.5";
  EXPECT_EQ(truth.mdf.Confidence(0)[row], 0);
  EXPECT_NEAR(truth.mdf.Distance(0)[row + 19], 4 / std::cos(RadFromDeg(70)), 1e-4) << "x = +9.5";
  EXPECT_EQ(truth.mdf.Confidence(0)[row + 19], 1);
  EXPECT_GT(truth.missed, 0u);
}

TEST(MdfTruth, RefusesAPlaneBelowTheTop) {
  const auto world = Build(Plane(6, Lambert(0.5, 0.5, 0.5), 20));
  EXPECT_FALSE(ComputeMdfTruth(*world, Header({View(0, 0)}), 1).ok());
  EXPECT_FALSE(ComputeMdfTruth(*world, Header({}), 1).ok());
}

TEST(Mesh, IsWhatRaysMeet) {
  const auto world = Build(Plane(2, Lambert(0.5, 0.5, 0.5), 4));
  const TriangleMesh mesh = world->Mesh();
  EXPECT_EQ(mesh.vertices.size(), 25u);
  ASSERT_EQ(mesh.triangles.size(), 32u);
  double area = 0;
  for (const auto& t : mesh.triangles) {
    const auto v = [&](int k) {
      const auto& p = mesh.vertices.at(t[static_cast<size_t>(k)]);
      return Vec3{p[0], p[1], p[2]};
    };
    const Vec3 n = Cross(v(1) - v(0), v(2) - v(0));
    EXPECT_GE(n.z, 0) << "counter-clockwise from above";
    area += n.z / 2;
  }
  EXPECT_NEAR(area, 16, 1e-5);
  const auto path =
      std::filesystem::temp_directory_path() / fmt::format("mesorig-{}.obj", getpid());
  ASSERT_TRUE(WriteMesh(*world, path).ok());
  std::istringstream text(ReadFile(path).value());
  std::filesystem::remove(path);
  size_t v = 0, f = 0;
  for (std::string line; std::getline(text, line);) {
    v += line.starts_with("v ");
    f += line.starts_with("f ");
  }
  EXPECT_EQ(v, 25u);
  EXPECT_EQ(f, 32u);
}

}  // namespace
}  // namespace mesorig::world
