// The rig files that ship: complete, and free of obstacles at the angles that they promise.

#include <gtest/gtest.h>

#include <string>
#include <utility>

#include "protocol/rig/rig_geometry.h"

namespace mesorig {
namespace {

Rig Load(const std::string& name) {
  return LoadRig(std::string(MESORIG_SOURCE_DIR) + "/rigs/" + name + ".toml").value();
}

void ExpectWangsParts(const Rig& rig) {
  EXPECT_EQ(rig.cameras.size(), 8u);
  EXPECT_EQ(rig.lamps.size(), 8u);
  EXPECT_EQ(rig.FindAxis("turntable"), 0);
  EXPECT_EQ(rig.FindAxis("light_arc"), 1);
  for (const Camera& camera : rig.cameras) {
    EXPECT_EQ(camera.pattern, BayerPattern::kRggb);
    EXPECT_EQ(camera.bits, 12);
  }
}

// Over all combinations of turntable and light arc angles (degrees): nothing blocked, and at least
// `min_apart_deg` between any lamp and camera as the sample sees them.
void ExpectFree(const Rig& rig, const std::vector<double>& turntable,
                const std::vector<double>& arc, double min_apart_deg) {
  for (double t : turntable) {
    for (double a : arc) {
      const std::vector<double> axes = {RadFromDeg(t), RadFromDeg(a)};
      for (int c = 0; c < static_cast<int>(rig.cameras.size()); ++c) {
        const auto solid = BlockedBy(rig, WorldFromCamera(rig, c, axes).translation, axes);
        ASSERT_FALSE(solid) << rig.cameras[c].name << " at " << t << ", " << a << ": " << *solid;
      }
      for (int l = 0; l < static_cast<int>(rig.lamps.size()); ++l) {
        const auto solid = BlockedBy(rig, LampInWorld(rig, l, axes), axes);
        ASSERT_FALSE(solid) << rig.lamps[l].name << " at " << t << ", " << a << ": " << *solid;
        const Vec3 light = Normalized(LampInSample(rig, l, axes));
        for (int c = 0; c < static_cast<int>(rig.cameras.size()); ++c) {
          const Vec3 view = Normalized(SampleFromCamera(rig, c, axes).translation);
          ASSERT_GT(DegFromRad(AngleBetween(light, view)), min_apart_deg)
              << rig.cameras[c].name << " " << rig.lamps[l].name << " at " << t << ", " << a;
        }
      }
    }
  }
}

TEST(RigFiles, DemoIsFreeAtItsPlansAngles) {
  const Rig rig = Load("demo");
  ExpectWangsParts(rig);
  EXPECT_EQ(rig.cameras[0].width, 256);
  EXPECT_EQ(rig.cameras[0].height, 192);
  ExpectFree(rig, {0, 60, 120, 180, 240, 300}, {30, 90, 150, 210, 270, 330}, 5);
}

TEST(RigFiles, WangIsFreeAtTwelveByTwelveAngles) {
  const Rig rig = Load("wang2005");
  ExpectWangsParts(rig);
  EXPECT_EQ(rig.cameras[0].width, 1024);
  EXPECT_EQ(rig.cameras[0].height, 768);
  std::vector<double> turntable, arc;
  for (int i = 0; i < 12; ++i) {
    turntable.push_back(30 * i);
    arc.push_back(15 + 30 * i);
  }
  ExpectFree(rig, turntable, arc, 3);
}

void ExpectLaserFree(const Rig& rig, const std::vector<int>& mounts,
                     const std::vector<double>& turntable, const std::vector<double>& arc) {
  for (double t : turntable) {
    for (double a : arc) {
      const std::vector<double> axes = {RadFromDeg(t), RadFromDeg(a)};
      for (int m : mounts) {
        const auto solid = BlockedBy(rig, LaserInWorld(rig, m, axes).source, axes);
        ASSERT_FALSE(solid) << rig.laser->mounts[m].name << " at " << t << ", " << a << ": "
                            << *solid;
      }
    }
  }
}

TEST(RigFiles, LaserMountsAreFree) {
  const Rig demo = Load("demo");
  ASSERT_TRUE(demo.laser && demo.turntable);
  EXPECT_EQ(demo.FindMount("zenith"), 0);
  EXPECT_EQ(demo.FindMount("slant"), 1);
  ExpectLaserFree(demo, {0, 1}, {0, 60, 120, 180, 240, 300}, {30, 90, 150, 210, 270, 330});
  const Rig wang = Load("wang2005");
  ASSERT_TRUE(wang.laser && wang.turntable);
  ASSERT_EQ(wang.laser->mounts.size(), 6u);
  std::vector<double> twelve;
  for (int i = 0; i < 12; ++i) twelve.push_back(15 + 30 * i);
  ExpectLaserFree(wang, {0, 1, 2, 3, 4, 5}, {0, 30, 60}, twelve);
}

// Does the segment from p (z = 0) to q pass through the box |x|, |y| <= half, 0 <= z <= top?
bool ThroughBox(Vec3 p, Vec3 q, double half, double top) {
  double from = 0, to = 1;
  const auto clip = [&](double at, double step, double low, double high) {
    const double a = (low - at) / step, b = (high - at) / step;
    from = std::max(from, std::min(a, b));
    to = std::min(to, std::max(a, b));
  };
  clip(p.x, q.x - p.x, -half, half);
  clip(p.y, q.y - p.y, -half, half);
  clip(p.z, q.z - p.z, 0, top);
  return from <= to;
}

// Millimetres of the stripe at x (docs/laser.md) that the camera sees on the turntable beside a
// plate of `extent` and 4.2 mm height.
double StripeSeenMm(const Rig& rig, int camera, const std::vector<double>& axes, int mount,
                    double x, double extent) {
  const LaserPose pose = LaserInSample(rig, mount, axes);
  const RigidTransform sample_from_camera = SampleFromCamera(rig, camera, axes);
  const RigidTransform camera_from_sample = Inverse(sample_from_camera);
  const Vec3 towards = Normalized(Vec3{pose.source.x, pose.source.y, 0});
  const Camera& c = rig.cameras[camera];
  int seen = 0;
  for (int i = -300; i <= 300; ++i) {
    const Vec3 p = x * towards + 0.2 * i * pose.axis;
    const auto at = Project(c, camera_from_sample * p);
    seen += Norm(p) < rig.turntable->radius_mm && at && at->u > 1 && at->v > 1 &&
            at->u < c.width - 1 && at->v < c.height - 1 &&
            !ThroughBox(p, sample_from_camera.translation, extent / 2, 4.2) &&
            !ThroughBox(p, pose.source, extent / 2, 4.2);
  }
  return 0.2 * seen;
}

// The demo's three sources: wherever the sheet stands, every camera sees some of it beside the plate
// of rigs/samples/weave.toml (44 mm), and those at 40 degrees and more see much of it.
TEST(RigFiles, DemoCamerasSeeTheStripeBesideTheSample) {
  const Rig rig = Load("demo");
  for (const auto& [mount, arc] : {std::pair{0, 150}, {1, 150}, {1, 330}}) {
    for (int t = 0; t < 360; t += 60) {
      for (int c = 0; c < 8; ++c) {
        for (double x = -28; x <= 28; x += 7) {
          const std::vector<double> axes = {RadFromDeg(t), RadFromDeg(arc)};
          EXPECT_GT(StripeSeenMm(rig, c, axes, mount, x, 44), c < 3 ? 8 : 17)
              << rig.cameras[c].name << " at " << t << ", " << arc << ", x = " << x;
        }
      }
    }
  }
}

TEST(RigFiles, LightArcBeforeTheCamerasBlocksThem) {
  const Rig rig = Load("wang2005");
  const std::vector<double> axes = {0, 0};
  EXPECT_TRUE(BlockedBy(rig, WorldFromCamera(rig, 4, axes).translation, axes));
}

// A sample of 40 mm is seen whole by every camera at every turntable angle.
TEST(RigFiles, SampleFillsTheFrame) {
  for (const char* name : {"demo", "wang2005"}) {
    const Rig rig = Load(name);
    double largest = 0;
    for (int c = 0; c < 8; ++c) {
      const Camera& camera = rig.cameras[c];
      for (int t = 0; t < 360; t += 15) {
        const std::vector<double> axes = {RadFromDeg(t), 0};
        for (Vec3 corner : {Vec3{20, 20, 4.2}, Vec3{-20, 20, 4.2}, Vec3{20, -20, 0}}) {
          const auto p = Project(camera, Inverse(SampleFromCamera(rig, c, axes)) * corner);
          ASSERT_TRUE(p);
          ASSERT_TRUE(p->u > 0 && p->v > 0 && p->u < camera.width && p->v < camera.height)
              << camera.name << " " << t << " " << p->u << " " << p->v;
          if (c == 0) largest = std::max(largest, std::abs(p->v - camera.cy));
        }
      }
    }
    EXPECT_GT(largest, 0.9 * rig.cameras[0].height / 2);
  }
}

}  // namespace
}  // namespace mesorig
