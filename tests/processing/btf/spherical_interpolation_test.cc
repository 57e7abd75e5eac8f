#include "processing/btf/spherical_interpolation.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "tests/processing/btf/synthetic.h"

namespace mesorig::btf {
namespace {

DirectionInterpolator Built(const std::vector<Vec3>& directions) {
  auto interpolator = DirectionInterpolator::Build(directions);
  EXPECT_TRUE(interpolator.ok()) << interpolator.status();
  return *std::move(interpolator);
}

Vec3 WeightedSum(const DirectionInterpolator& i, const DirectionWeights& w) {
  Vec3 sum;
  for (size_t k = 0; k < 3; ++k) {
    sum = sum + w.weight[k] * i.directions()[static_cast<size_t>(w.index[k])];
  }
  return sum;
}

void ExpectWeightsValid(const DirectionInterpolator& interpolator, const DirectionWeights& w) {
  double sum = 0;
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_GE(w.weight[k], 0.0f);
    EXPECT_GE(w.index[k], 0);
    EXPECT_LT(w.index[k], static_cast<int>(interpolator.directions().size()));
    if (w.weight[k] == 0) {
      EXPECT_EQ(w.index[k], 0);
    }
    sum += w.weight[k];
  }
  EXPECT_NEAR(sum, 1, 1e-6);
}

Vec3 RandomDirection(std::mt19937& random, double min_z) {
  std::uniform_real_distribution<double> z(min_z, 1), phi(0, 2 * kPi);
  return DirectionFromAngles(std::acos(z(random)), phi(random));
}

// Sets that people measure: ring patterns (all cocircular), kaleidoscopes, scattered ones.
std::vector<std::vector<Vec3>> Sets() {
  std::vector<std::vector<Vec3>> sets = {
      RingDirections(1, 6, 45),  RingDirections(3, 8, 75), RingDirections(5, 24, 75),
      RingDirections(2, 12, 90), RingDirections(1, 3, 30),
  };
  std::vector<Vec3> ring = RingDirections(1, 8, 50);
  ring.erase(ring.begin());  // no pole: one small circle, coplanar in space
  sets.push_back(ring);
  std::vector<Vec3> grid;
  for (int x = -3; x <= 3; ++x) {
    for (int y = -3; y <= 3; ++y) grid.push_back(Normalized(Vec3{0.2 * x, 0.2 * y, 1}));
  }
  sets.push_back(grid);
  std::mt19937 random(3);
  for (int n : {3, 4, 5, 12, 100}) {
    std::vector<Vec3> scattered;
    for (int i = 0; i < n; ++i) scattered.push_back(RandomDirection(random, 0.1));
    sets.push_back(scattered);
  }
  return sets;
}

TEST(DirectionInterpolator, ExactAtTheMeasuredDirections) {
  for (const auto& set : Sets()) {
    const DirectionInterpolator interpolator = Built(set);
    for (size_t i = 0; i < set.size(); ++i) {
      const DirectionWeights w = interpolator.Lookup(2.5 * set[i]);
      ExpectWeightsValid(interpolator, w);
      double at_node = 0;
      for (size_t k = 0; k < 3; ++k) {
        if (w.weight[k] > 0 && w.index[k] == static_cast<int>(i)) at_node += w.weight[k];
      }
      EXPECT_NEAR(at_node, 1, 1e-6) << set.size() << " directions, node " << i;
      EXPECT_TRUE(interpolator.Inside(set[i]));
    }
  }
}

TEST(DirectionInterpolator, InsideTheConeTheWeightedDirectionIsTheOneAskedFor) {
  std::mt19937 random(11);
  for (const auto& set : Sets()) {
    const DirectionInterpolator interpolator = Built(set);
    int inside = 0;
    for (int i = 0; i < 2000; ++i) {
      // A positive combination of three directions lies inside by definition.
      Vec3 d;
      for (int k = 0; k < 3; ++k) {
        d = d + (static_cast<double>(random() % 1000) + 1) * set[random() % set.size()];
      }
      d = Normalized(d);
      const DirectionWeights w = interpolator.Lookup(d);
      ExpectWeightsValid(interpolator, w);
      EXPECT_LT(AngleBetween(Normalized(WeightedSum(interpolator, w)), d), 1e-5);
      inside += interpolator.Inside(d) ? 1 : 0;
    }
    EXPECT_EQ(inside, 2000) << set.size();
  }
}

// Over a dense walk the interpolated value moves no faster than the data can: no steps at edges,
// nor where the cone ends.
TEST(DirectionInterpolator, IsContinuous) {
  std::mt19937 random(5);
  for (const auto& set : Sets()) {
    const DirectionInterpolator interpolator = Built(set);
    std::vector<double> values;
    for (size_t i = 0; i < set.size(); ++i) values.push_back(std::sin(3.0 * set[i].x) + set[i].y);
    const auto value = [&](Vec3 d) {
      const DirectionWeights w = interpolator.Lookup(d);
      double sum = 0;
      for (size_t k = 0; k < 3; ++k) sum += w.weight[k] * values[static_cast<size_t>(w.index[k])];
      return sum;
    };
    for (int walk = 0; walk < 50; ++walk) {
      const Vec3 from = RandomDirection(random, 0.05), to = RandomDirection(random, 0.05);
      for (int step = 0; step < 100; ++step) {
        const Vec3 d = Normalized(from + (step / 100.0) * (to - from));
        const Vec3 e = Normalized(d + 1e-7 * (to - from));
        EXPECT_NEAR(value(d), value(e), 2e-4);
      }
    }
  }
}

// What the grid leaves out changes nothing: beside a search through all triangles and the whole rim.
TEST(DirectionInterpolator, FindsWhatASearchThroughEverythingFinds) {
  std::mt19937 random(23);
  for (const auto& set : Sets()) {
    const DirectionInterpolator interpolator = Built(set);
    for (int i = 0; i < 3000; ++i) {
      Vec3 d = RandomDirection(random, -1);
      if (i % 3 == 0) d = Normalized(set[random() % set.size()] + 1e-8 * d);
      if (i % 3 == 1) d = Normalized(set[random() % set.size()] + set[random() % set.size()]);
      if (Norm(d) < 0.5) continue;  // two opposite ones
      bool inside = false;
      for (const auto& t : interpolator.triangles()) {
        const Vec3 a = set[static_cast<size_t>(t[0])], b = set[static_cast<size_t>(t[1])],
                   c = set[static_cast<size_t>(t[2])];
        inside = inside || (Dot(Cross(a, b), d) > -1e-12 && Dot(Cross(b, c), d) > -1e-12 &&
                            Dot(Cross(c, a), d) > -1e-12);
      }
      const double found =
          AngleBetween(Normalized(WeightedSum(interpolator, interpolator.Lookup(d))), d);
      if (inside) {
        EXPECT_LT(found, 1e-6);
      } else if (!interpolator.hull().empty()) {
        double nearest = kPi;
        for (const auto& [a, b] : interpolator.hull()) {
          const ArcPoint p =
              Arc(set[static_cast<size_t>(a)], set[static_cast<size_t>(b)]).Nearest(d);
          const Vec3 q = p.weight_a * set[static_cast<size_t>(a)] +
                         p.weight_b * set[static_cast<size_t>(b)];
          nearest = std::min(nearest, AngleBetween(Normalized(q), d));
        }
        EXPECT_NEAR(found, nearest, 1e-6);
      }
    }
  }
}

TEST(DirectionInterpolator, TrianglesCoverTheConeOnce) {
  std::mt19937 random(17);
  for (const auto& set : Sets()) {
    const DirectionInterpolator interpolator = Built(set);
    for (int i = 0; i < 300; ++i) {
      const Vec3 d = RandomDirection(random, 0.0);
      int holding = 0;
      for (const auto& t : interpolator.triangles()) {
        const Vec3 a = set[static_cast<size_t>(t[0])], b = set[static_cast<size_t>(t[1])],
                   c = set[static_cast<size_t>(t[2])];
        EXPECT_GT(Dot(a, Cross(b, c)), 0);
        holding += Dot(Cross(a, b), d) > 1e-12 && Dot(Cross(b, c), d) > 1e-12 &&
                           Dot(Cross(c, a), d) > 1e-12
                       ? 1
                       : 0;
      }
      EXPECT_LE(holding, 1);
    }
  }
}

TEST(DirectionInterpolator, IsDelaunay) {
  for (const auto& set : Sets()) {
    const DirectionInterpolator interpolator = Built(set);
    for (const auto& t : interpolator.triangles()) {
      const Vec3 a = set[static_cast<size_t>(t[0])];
      const Vec3 n = Normalized(Cross(set[static_cast<size_t>(t[1])] - a,
                                      set[static_cast<size_t>(t[2])] - a));
      for (const Vec3& d : set) EXPECT_LT(Dot(n, d - a), 1e-9);  // empty circumscribed cap
    }
  }
}

TEST(DirectionInterpolator, OneAndTwoDirections) {
  const Vec3 a = DirectionFromAngles(0.5, 1), b = DirectionFromAngles(0.9, 1);
  const DirectionInterpolator one = Built({a});
  EXPECT_EQ(one.Lookup({1, 0, 0}).weight[0], 1.0f);
  EXPECT_TRUE(one.Inside(a));
  EXPECT_FALSE(one.Inside(b));
  const DirectionInterpolator two = Built({a, b});
  const DirectionWeights middle = two.Lookup(a + b);
  EXPECT_NEAR(middle.weight[0], 0.5, 1e-6);
  EXPECT_NEAR(middle.weight[1], 0.5, 1e-6);
  // Beside the arc: the foot of the perpendicular.
  const Vec3 beside = Normalized(a + b) + 0.2 * Normalized(Cross(a, b));
  EXPECT_NEAR(two.Lookup(beside).weight[0], 0.5, 1e-6);
  // Beyond its end: the end.
  const DirectionWeights beyond = two.Lookup(DirectionFromAngles(1.3, 1));
  EXPECT_EQ(beyond.index[1], 1);
  EXPECT_EQ(beyond.weight[1], 1.0f);
}

TEST(DirectionInterpolator, OneGreatCircle) {
  std::vector<Vec3> arc;
  for (int i : {3, -2, 0, 1, -4}) arc.push_back(DirectionFromAngles(RadFromDeg(18.0 * i), 0.3));
  const DirectionInterpolator interpolator = Built(arc);
  EXPECT_TRUE(interpolator.triangles().empty());
  for (size_t i = 0; i < arc.size(); ++i) EXPECT_TRUE(interpolator.Inside(arc[i]));
  const Vec3 between = DirectionFromAngles(RadFromDeg(9), 0.3);  // halfway between entries 2 and 3
  const DirectionWeights w = interpolator.Lookup(between);
  ExpectWeightsValid(interpolator, w);
  EXPECT_NEAR(w.weight[0], 0.5, 1e-6);
  EXPECT_EQ(w.index[0] + w.index[1], 5);
}

TEST(DirectionInterpolator, DuplicatesAreNeverChosenTwice) {
  std::vector<Vec3> set = RingDirections(2, 6, 60);
  const size_t n = set.size();
  for (int i = 0; i < 5; ++i) set.push_back(DirectionFromAngles(1e-7 * i, 1.0 * i));
  const DirectionInterpolator interpolator = Built(set);
  std::mt19937 random(23);
  for (int i = 0; i < 500; ++i) {
    const DirectionWeights w = interpolator.Lookup(RandomDirection(random, 0));
    for (int index : w.index) EXPECT_LT(index, static_cast<int>(n));
  }
}

TEST(DirectionInterpolator, RefusesAndSurvivesNonsense) {
  EXPECT_FALSE(DirectionInterpolator::Build({}).ok());
  EXPECT_FALSE(DirectionInterpolator::Build({{0, 0, 0}}).ok());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(DirectionInterpolator::Build({{0, 0, 1}, {nan, 0, 1}}).ok());
  const DirectionInterpolator ok = Built(RingDirections(2, 6, 60));
  for (const Vec3 d : {Vec3{0, 0, 0}, Vec3{nan, 0, 1}, Vec3{1e300, 1e300, 0}}) {
    ExpectWeightsValid(ok, ok.Lookup(d));
    EXPECT_EQ(ok.Lookup(d).index[0], 0);
  }
  ExpectWeightsValid(ok, ok.Lookup({0, 0, -1}));
}

TEST(HorizonScale, LambertIsExactBeyondTheConeAndZeroBelow) {
  const auto set = RingDirections(2, 12, 60);
  const DirectionInterpolator lights = Built(set);
  const Vec3 inside = DirectionFromAngles(RadFromDeg(40), 0.2);
  EXPECT_NEAR(HorizonScale(lights, lights.Lookup(inside), inside), 1, 1e-6);
  const Vec3 beyond = DirectionFromAngles(RadFromDeg(80), 2 * kPi * 3 / 12 + 0.2);
  const double scale = HorizonScale(lights, lights.Lookup(beyond), beyond);
  EXPECT_NEAR(scale, std::cos(RadFromDeg(80)) / std::cos(RadFromDeg(60)), 1e-6);
  const Vec3 below = DirectionFromAngles(RadFromDeg(95), 1);
  EXPECT_EQ(HorizonScale(lights, lights.Lookup(below), below), 0);
  const DirectionInterpolator grazing = Built({DirectionFromAngles(RadFromDeg(89.999), 0)});
  EXPECT_LE(HorizonScale(grazing, grazing.Lookup({0, 0, 1}), {0, 0, 1}), kMaxHorizonScale);
}

}  // namespace
}  // namespace mesorig::btf
