// Silhouettes with known answers: the interval test on circles in closed form, and the same pixels
// on the CPU.

#include "renderer/gl/silhouettes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <optional>

#include "renderer/gl/scene_renderer.h"
#include "renderer/gl/silhouette_check.h"
#include "tests/renderer/gl/synthetic.h"

namespace mesorig::renderer {
namespace {

using testing::HasSubstr;

constexpr double kMajor = 50, kMinor = 22;
const std::vector<Vec3> kViews = Rings(RadFromDeg(86), RadFromDeg(7));

BtfSource GreyBtf(int size = 4, double pitch_mm = 10) {
  auto source = BtfSource::FromSampled(MakeBtf(size, size, pitch_mm, {{0, 0, 1}}, {{0, 0, 1}},
                                               [](int, int, Vec3, Vec3 l) { return 0.2 * l.z; }));
  EXPECT_TRUE(source.ok()) << source.status();
  return *std::move(source);
}

btf::Mdf PlaneMdf(double depth_mm, int size = 4, double pitch_mm = 10) {
  return MakeMdf(size, pitch_mm, kViews, [=](int, int, Vec3 v) { return depth_mm / v.z; });
}

Scene MdfTorus() {
  Scene scene = TorusScene({0.3, -0.5, 1});
  scene.objects[0].material = Material::kBtfMdf;
  scene.objects[0].mm_per_unit = 40;
  return scene;
}

// A torus from far above, along its axis: every ray lies in a meridian plane, where the tube is a
// circle.
Scene TorusFromAbove() {
  Scene scene = MdfTorus();
  scene.camera.eye_mm = {0, 0, 2000};
  scene.camera.up = {0, 1, 0};
  scene.camera.fov_rad = 2 * std::atan(80.0 / 2000);
  scene.image.width = scene.image.height = 480;
  return scene;
}

// Where a ray of that scene cuts the tube's circle.
struct Cut {
  double b = 0;       // from the tube's centre to the ray, mm; positive outwards
  double chord = 0;   // mm; 0 for none
  double cosine = 0;  // at both ends
  double phi_f = 0, phi_b = 0;
  double theta = 0;  // azimuth
};
Cut CutOf(const Scene& scene, double x, double y) {
  const double half = scene.image.width / 2.0, scale = std::tan(scene.camera.fov_rad / 2) / half;
  const double px = (x - half) * scale, py = (half - y) * scale;
  const double slope = std::hypot(px, py);  // the ray: rho = slope * (2000 - z)
  const double norm = std::hypot(slope, 1);
  Cut cut;
  cut.theta = std::atan2(py, px);
  cut.b = (slope * 2000 - kMajor) / norm;
  if (std::abs(cut.b) >= kMinor) return cut;
  cut.cosine = std::sqrt(1 - cut.b * cut.b / (kMinor * kMinor));
  cut.chord = 2 * kMinor * cut.cosine;
  const double normal_angle = std::atan(slope);  // of the ray's normal, from the plane
  const double half_angle = std::acos(cut.b / kMinor);
  cut.phi_f = normal_angle + half_angle;
  cut.phi_b = normal_angle - half_angle;
  return cut;
}
double AreaStretch(double phi) { return 1 + kMinor / kMajor * std::cos(phi); }

class SilhouettesTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = GlContext::Create();
    if (!context.ok()) GTEST_SKIP() << context.status();
    context_.emplace(*std::move(context));
  }
  SceneRenderer Renderer(const Scene& scene, const BtfSource& source, const btf::Mdf& mdf) {
    auto renderer = SceneRenderer::Create(scene, source, *context_, &mdf);
    EXPECT_TRUE(renderer.ok()) << renderer.status();
    return *std::move(renderer);
  }
  std::vector<Fragment> Probe(const Scene& scene, const BtfSource& source, const btf::Mdf& mdf) {
    auto fragments = Renderer(scene, source, mdf).Probe();
    EXPECT_TRUE(fragments.ok()) << fragments.status();
    return fragments.ok() ? *std::move(fragments) : std::vector<Fragment>();
  }
  // 1 where object 0 is seen.
  std::vector<char> Mask(const Scene& scene, const BtfSource& source, const btf::Mdf& mdf) {
    std::vector<char> mask(static_cast<size_t>(scene.image.width * scene.image.height));
    for (const Fragment& f : Probe(scene, source, mdf)) {
      if (f.object == 0) mask[static_cast<size_t>(f.y * scene.image.width + f.x)] = 1;
    }
    return mask;
  }
  Status CreateStatus(const Scene& scene, const BtfSource& source, const btf::Mdf* mdf) {
    return SceneRenderer::Create(scene, source, *context_, mdf).status();
  }
  std::optional<GlContext> context_;
};

TEST_F(SilhouettesTest, AReliefOfNoDepthChangesNoPixel) {
  auto source = BtfSource::FromSampled(MakeBumpyBtf(16, Rings(RadFromDeg(60), RadFromDeg(30)),
                                                    Rings(RadFromDeg(60), RadFromDeg(30))));
  ASSERT_TRUE(source.ok());
  const btf::Mdf zero = PlaneMdf(0, 16, 2.5);
  Scene scene = MdfTorus();
  Object slab;  // cuts the torus
  slab.material = Material::kBtfMdf;
  slab.size_mm = {60, 60, 60};
  slab.rounding_mm = 30;  // a ball: its texture has triangles without area
  slab.position_mm = {40, -20, 10};
  slab.rotation_rad = {0.2, 0.4, 0.1};
  scene.objects.push_back(slab);
  slab.material = Material::kPlain;
  slab.rounding_mm = 0;
  slab.position_mm = {-40, -20, -10};
  scene.objects.push_back(slab);
  for (const int supersample : {1, 2}) {
    scene.image.supersample = supersample;
    Scene without = scene;
    for (Object& object : without.objects) {
      if (object.material == Material::kBtfMdf) object.material = Material::kBtf;
    }
    SceneRenderer with_mdf = Renderer(scene, *source, zero);
    SceneRenderer btf_only = Renderer(without, *source, zero);
    with_mdf.Draw();
    btf_only.Draw();
    EXPECT_EQ(with_mdf.ReadPicture()->rgb, btf_only.ReadPicture()->rgb);
    EXPECT_EQ(btf_only.silhouette_passes().passes, 0);
    EXPECT_GE(with_mdf.silhouette_passes().passes, 1);
    EXPECT_FALSE(with_mdf.silhouette_passes().exhausted);
  }
}

// The relief's bottom is a plane at depth h: the object looks shrunk by h times the square root of
// the area stretch. In the tube's circle of radius r: the test with curved rays is
// b <= sqrt(r^2 - 2 r h), with straight ones (the paper's) b <= sqrt(r^2 - r h).
TEST_F(SilhouettesTest, AConstantDepthShrinksTheSurface) {
  const BtfSource source = GreyBtf();
  const double depth = 1.5;
  const btf::Mdf mdf = PlaneMdf(depth);
  Scene scene = TorusFromAbove();
  const double pixel = 2 * 80.0 / scene.image.height;
  for (const bool curved : {true, false}) {
    scene.silhouettes.follow_curvature = curved;
    const auto mask = Mask(scene, source, mdf);
    int inside = 0, outside = 0;
    for (int y = 0; y < scene.image.height; ++y) {
      for (int x = 0; x < scene.image.width; ++x) {
        const Cut cut = CutOf(scene, x + 0.5, y + 0.5);
        if (cut.chord == 0) continue;
        const double h = depth * std::sqrt(AreaStretch(cut.phi_f));
        const double limit = std::sqrt(kMinor * kMinor - (curved ? 2 : 1) * kMinor * h);
        if (curved) {
          ASSERT_NEAR(limit, kMinor - h, pixel);
        }
        const bool seen = mask[static_cast<size_t>(y * scene.image.width + x)] != 0;
        if (std::abs(cut.b) < limit - pixel) {
          ASSERT_TRUE(seen) << x << ", " << y << " b " << cut.b << " of " << limit;
          ++inside;
        } else if (std::abs(cut.b) > limit + pixel) {
          ASSERT_FALSE(seen) << x << ", " << y << " b " << cut.b << " of " << limit;
          ++outside;
        }
      }
    }
    EXPECT_GT(inside, 20000);
    EXPECT_GT(outside, curved ? 2000 : 500);
  }
}

// D = k in every direction: on the surface k / |v_t|, where v_t lies in the meridian plane. The
// texture is stretched along the torus only, so that an isotropic scale would give k sqrt(A).
TEST_F(SilhouettesTest, TheJacobianIsDirectional) {
  const BtfSource source = GreyBtf();
  const double k = 8;
  const btf::Mdf mdf = MakeMdf(4, 10, kViews, [&](int, int, Vec3) { return k; });
  Scene scene = TorusFromAbove();
  scene.silhouettes.follow_curvature = false;
  const double pixel = 2 * 80.0 / scene.image.height;
  const auto mask = Mask(scene, source, mdf);
  // The tube's outermost seen ray on every azimuth's side.
  const auto distance = [&](const Cut& cut, bool isotropic) {
    double sum = 0;
    for (const double phi : {cut.phi_f, cut.phi_b}) {
      const double area = AreaStretch(phi), c = cut.cosine;
      sum += isotropic ? k * std::sqrt(area) : k / std::sqrt(1 - c * c + c * c / area);
    }
    return sum;
  };
  int right = 0, wrong = 0, isotropic_wrong = 0;
  for (int y = 0; y < scene.image.height; ++y) {
    for (int x = 0; x < scene.image.width; ++x) {
      const Cut cut = CutOf(scene, x + 0.5, y + 0.5);
      if (cut.chord == 0) continue;
      // A pixel's width of b is this much of the chord.
      const double tolerance = 2 * pixel * std::abs(cut.b) / (kMinor * cut.cosine) + 0.2;
      const bool seen = mask[static_cast<size_t>(y * scene.image.width + x)] != 0;
      const double margin = cut.chord - distance(cut, false);
      const double isotropic = cut.chord - distance(cut, true);
      if (std::abs(margin) > tolerance) (seen == (margin > 0) ? right : wrong) += 1;
      if (std::abs(isotropic) > tolerance && seen != (isotropic > 0)) ++isotropic_wrong;
    }
  }
  EXPECT_GT(right, 20000);
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(isotropic_wrong, 300);
}

// A checkerboard of a plane at depth 0 and one at 2 mm: notches where the closed form has them.
TEST_F(SilhouettesTest, AStepNotchesTheSilhouetteWhereItLies) {
  const int size = 16;
  const double depth = 2;
  // (u, v): repeats from the top left corner. A quarter down, so that both ends of a ray near the
  // silhouette, at v and 1 - v, lie in fields of one kind.
  const auto low = [&](double u, double v) {
    v += 0.25;
    return (u - std::floor(u) < 0.5) != (v - std::floor(v) < 0.5);
  };
  const btf::Mdf mdf = MakeMdf(size, 2.5, kViews, [&](int x, int y, Vec3 v) {
    return low((x + 0.5) / size, (y + 0.5) / size) ? depth / v.z : 0;
  });
  const BtfSource source = GreyBtf(size, 2.5);
  Scene scene = TorusFromAbove();
  scene.silhouettes.follow_curvature = false;
  const double repeats_x = 8, repeats_y = 3;
  scene.objects[0].whole_repeats = true;
  const double pixel = 2 * 80.0 / scene.image.height;
  const auto mask = Mask(scene, source, mdf);
  int notched = 0, full = 0;
  for (int y = 0; y < scene.image.height; ++y) {
    for (int x = 0; x < scene.image.width; ++x) {
      const Cut cut = CutOf(scene, x + 0.5, y + 0.5);
      if (cut.chord == 0) continue;
      double met = 0;
      bool near_step = false;
      for (const double phi : {cut.phi_f, cut.phi_b}) {
        const double turn = std::remainder(phi, 2 * kPi);
        const double u = 0.5 + repeats_x * cut.theta / (2 * kPi);
        const double v = 0.5 - repeats_y * turn / (2 * kPi);
        for (const double t : {2 * u, 2 * v + 0.5}) {
          near_step = near_step || std::abs(t - std::round(t)) < 2 * 1.2 / size;
        }
        // mm of the surface a mm of the sample, along the torus and around it.
        const double sx = 2 * kPi * kMajor / repeats_x / 40 * AreaStretch(phi);
        const double sy = 2 * kPi * kMinor / repeats_y / 40;
        if (low(u, v)) met += depth * std::sqrt(sx * sy) / cut.cosine;
      }
      const double tolerance = 2 * pixel * std::abs(cut.b) / (kMinor * cut.cosine) + 0.1;
      const double margin = cut.chord - met;
      if (near_step || std::abs(margin) < tolerance) continue;
      const bool seen = mask[static_cast<size_t>(y * scene.image.width + x)] != 0;
      ASSERT_EQ(seen, margin > 0) << x << ", " << y;
      if (met == 0 && std::abs(cut.b) > 0.9 * kMinor) ++full;
      if (!seen) ++notched;
    }
  }
  EXPECT_GT(notched, 100);
  EXPECT_GT(full, 100);
}

// A hilly relief (D along the ray by marching, not exact: what counts is that both sides read it).
btf::Mdf HillyMdf() {
  const int size = 24;
  const double pitch = 40.0 / size;
  return MakeMdf(size, pitch, kViews, [=](int x, int y, Vec3 v) {
    for (double t = 0;; t += 0.05) {
      const double a = 2 * kPi * ((x + 0.5) / size - t * v.x / 40);
      const double b = 2 * kPi * ((y + 0.5) / size + t * v.y / 40);
      const double depth = 2.5 * (1 - std::cos(2 * a) * std::cos(3 * b)) / 2;
      if (t * v.z >= depth) return t;
    }
  });
}

TEST_F(SilhouettesTest, AgreesWithTheCpu) {
  const BtfSource source = GreyBtf(24, 40.0 / 24);
  const btf::Mdf mdf = HillyMdf();
  Scene scene = MdfTorus();
  scene.objects[0].whole_repeats = true;
  scene.objects[0].rotation_rad = {0.9, 0.3, 0.2};
  Object slab;
  slab.material = Material::kBtfMdf;
  slab.size_mm = {70, 50, 12};
  slab.rounding_mm = 5;
  slab.mm_per_unit = 30;
  slab.position_mm = {60, -60, 30};
  slab.rotation_rad = {-0.7, 0.4, 0.3};
  scene.objects.push_back(slab);
  for (const bool curved : {true, false}) {
    scene.silhouettes.follow_curvature = curved;
    const auto check = CompareSilhouettesWithCpu(scene, mdf, Probe(scene, source, mdf), 3000);
    ASSERT_TRUE(check.ok()) << check.status();
    EXPECT_EQ(check->pixels, 3000u);
    EXPECT_LE(check->differing, 4u);
    EXPECT_LT(check->worst_margin_mm, 0.5);
  }
  // It is the relief that is compared: without it far more pixels differ.
  const auto flat =
      CompareSilhouettesWithCpu(scene, mdf, Probe(scene, source, PlaneMdf(0, 24, 40.0 / 24)), 3000);
  EXPECT_GT(flat->differing, 30u);
}

// A torus seen from the side through its hole: rays that miss the near tube's relief meet the far
// tube.
TEST_F(SilhouettesTest, WhatIsMissedLetsTheNextLayerThrough) {
  const BtfSource source = GreyBtf();
  const btf::Mdf mdf = PlaneMdf(4);
  Scene scene = MdfTorus();
  scene.camera.eye_mm = {0, -400, 60};
  const auto cpu = CpuSilhouette::Create(scene, 0, mdf);
  ASSERT_TRUE(cpu.ok());
  SceneRenderer renderer = Renderer(scene, source, mdf);
  renderer.Draw();
  EXPECT_GE(renderer.silhouette_passes().passes, 2);
  EXPECT_FALSE(renderer.silhouette_passes().exhausted);
  const auto mask = Mask(scene, source, mdf);
  scene.silhouettes.max_passes = 1;
  SceneRenderer one_pass = Renderer(scene, source, mdf);
  one_pass.Draw();
  EXPECT_EQ(one_pass.silhouette_passes().passes, 1);
  EXPECT_TRUE(one_pass.silhouette_passes().exhausted);
  const auto first_layer = Mask(scene, source, mdf);
  int second = 0, differing = 0;
  for (int y = 0; y < scene.image.height; ++y) {
    for (int x = y % 3; x < scene.image.width; x += 3) {
      const auto at = static_cast<size_t>(y * scene.image.width + x);
      const auto result = cpu->At(x + 0.5, y + 0.5);
      if (result.margin < 0.05) continue;
      if (result.hit != (mask[at] != 0)) ++differing;
      if (result.interval == 1) {
        ++second;
        EXPECT_TRUE(mask[at]);
        EXPECT_FALSE(first_layer[at]);
      }
    }
  }
  EXPECT_GT(second, 20);
  EXPECT_LE(differing, 2);
}

// Seen from above: a plain slab whose top lies 1 mm below the reference surface of the other one.
TEST_F(SilhouettesTest, ObjectsMeetAtTheReliefsDepth) {
  const BtfSource source = GreyBtf();
  Scene scene = SlabFromAboveScene({0, 0, 1});
  scene.objects[0].material = Material::kBtfMdf;
  scene.objects[0].mm_per_unit = 40;
  Object plain = scene.objects[0];
  plain.material = Material::kPlain;
  plain.position_mm = {0, 0, -1};
  for (const bool plain_first : {false, true}) {
    scene.objects.resize(1);
    scene.objects.insert(plain_first ? scene.objects.begin() : scene.objects.end(), plain);
    for (const double depth : {0.5, 2.0}) {
      int seen[2] = {0, 0};
      for (const Fragment& f : Probe(scene, source, PlaneMdf(depth))) {
        if (std::abs(f.x - 120) < 30 && std::abs(f.y - 90) < 30) ++seen[f.object];
      }
      const int with_mdf = plain_first ? 1 : 0;
      EXPECT_EQ(seen[with_mdf] > 0, depth < 1) << depth;
      EXPECT_EQ(seen[1 - with_mdf] > 0, depth > 1) << depth;
    }
    scene.objects.erase(plain_first ? scene.objects.begin() : scene.objects.end() - 1);
  }
}

// Where the texture has no area, or none that is a number, there is no map: d = 0.
TEST_F(SilhouettesTest, WithoutAMapTheReferenceSurfaceIsSeen) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const btf::Mdf deep = PlaneMdf(100);
  Scene scene = MdfTorus();
  const auto silhouettes = Silhouettes::Create(deep, scene, context_->limits());
  ASSERT_TRUE(silhouettes.ok()) << silhouettes.status();
  const auto target = SilhouetteTarget::Create(scene.image.width, scene.image.height);
  ASSERT_TRUE(target.ok());
  GlMesh mesh = UploadObject(scene.objects[0], {1.0 / 40, 1.0 / 40});
  const size_t vertices = MakeMesh(scene.objects[0]).vertices.size();
  const auto hits = [&] {
    const SilhouettePasses passes = silhouettes->Find(mesh, *target);
    EXPECT_LE(passes.passes, 4);
    std::vector<float> values(static_cast<size_t>(scene.image.width * scene.image.height) * 2);
    glGetTextureImage(target->hit(), 0, GL_RG, GL_FLOAT,
                      static_cast<GLsizei>(values.size() * sizeof(float)), values.data());
    int count = 0;
    for (size_t i = 0; i < values.size(); i += 2) {
      EXPECT_TRUE(values[i + 1] >= 0);
      if (values[i] > 0) ++count;
    }
    return count;
  };
  EXPECT_EQ(hits(), 0);  // deeper than the torus is thick: nothing is left of it
  for (const Stretch& none : {Stretch{}, Stretch{{1, 0, 0}, {1, 0, 0}}, Stretch{{nan}, {nan}}}) {
    mesh.stretches = MakeBuffer(std::vector<Stretch>(vertices, none));
    glVertexArrayVertexBuffer(mesh.array.name(), 1, mesh.stretches.name(), 0, sizeof(Stretch));
    EXPECT_GT(hits(), 5000);
  }
}

TEST_F(SilhouettesTest, BadInputIsRefused) {
  const BtfSource source = GreyBtf();
  Scene scene = MdfTorus();
  EXPECT_THAT(std::string(Message(CreateStatus(scene, source, nullptr))), HasSubstr("no MDF"));
  btf::Mdf mdf = PlaneMdf(1);
  EXPECT_TRUE(CreateStatus(scene, source, &mdf).ok());
  scene.image.msaa = 4;
  EXPECT_THAT(std::string(Message(CreateStatus(scene, source, &mdf))), HasSubstr("msaa = 4"));
  scene.image.msaa = 1;
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), -0.1f, std::numeric_limits<float>::infinity()}) {
    mdf = PlaneMdf(1);
    mdf.MutableDistance(2)[5] = bad;
    const Status status = CreateStatus(scene, source, &mdf);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(Message(status)), HasSubstr("view 2, texel (1, 1)"));
  }
  mdf = PlaneMdf(1, 4, 12);
  EXPECT_THAT(std::string(Message(CreateStatus(scene, source, &mdf))), HasSubstr("same part"));
  // Without an object that has one, nothing is asked of the MDF.
  scene.objects[0].material = Material::kBtf;
  EXPECT_TRUE(CreateStatus(scene, source, &mdf).ok());
}

TEST(SilhouetteFilesTest, BtfAndMdfMustBeOfTheSameSample) {
  btf::MdfHeader mdf;
  mdf.width = 64;
  mdf.height = 32;
  mdf.pitch_mm = 0.5;
  mdf.h_ref_mm = 4;
  EXPECT_TRUE(CheckSameSample(64, 32, 0.5, 4, mdf).ok());
  EXPECT_TRUE(CheckSameSample(128, 64, 0.25, 4, mdf).ok());
  EXPECT_TRUE(CheckSameSample(64, 32, 0, 0, mdf).ok());  // photographs know neither
  EXPECT_FALSE(CheckSameSample(64, 64, 0, 0, mdf).ok());
  EXPECT_FALSE(CheckSameSample(64, 32, 0.6, 4, mdf).ok());
  EXPECT_FALSE(CheckSameSample(64, 32, 0.5, 3, mdf).ok());
}

}  // namespace
}  // namespace mesorig::renderer
