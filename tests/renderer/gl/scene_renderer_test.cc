// Physics of the picture: shading, frames, orientation, agreement with the CPU.

#include "renderer/gl/scene_renderer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <optional>

#include "processing/codecs/encoder.h"
#include "renderer/gl/cpu_check.h"
#include "renderer/scene/mesh.h"
#include "renderer/scene/view_transform.h"
#include "tests/renderer/gl/synthetic.h"

namespace mesorig::renderer {
namespace {

using testing::HasSubstr;

class SceneRendererTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = GlContext::Create();
    if (!context.ok()) GTEST_SKIP() << context.status();
    context_.emplace(*std::move(context));
  }
  std::vector<Fragment> Probe(const Scene& scene, const BtfSource& source) {
    auto renderer = SceneRenderer::Create(scene, source, *context_);
    EXPECT_TRUE(renderer.ok()) << renderer.status();
    if (!renderer.ok()) return {};
    auto fragments = renderer->Probe();
    EXPECT_TRUE(fragments.ok()) << fragments.status();
    return fragments.ok() ? *std::move(fragments) : std::vector<Fragment>();
  }
  std::optional<GlContext> context_;
};

BtfSource Source(btf::SampledBtf btf) {
  auto source = BtfSource::FromSampled(std::move(btf));
  EXPECT_TRUE(source.ok()) << source.status();
  return *std::move(source);
}

const Vec3 kLights[] = {{1, 0.2, 1}, {-0.3, 1, 1}, {-1, -0.4, 0.8}, {0.2, -1, 0.6}};

TEST_F(SceneRendererTest, ALambertBtfOnATorusIsALambertTorus) {
  const double rho = 0.6;
  const BtfSource source =
      Source(MakeBtf(2, 2, 20, {{0, 0, 1}}, Rings(RadFromDeg(88), RadFromDeg(4)),
                     [&](int, int, Vec3, Vec3 l) { return rho / kPi * l.z; }));
  for (const Vec3& light : kLights) {
    const Scene scene = TorusScene(light);
    const auto fragments = Probe(scene, source);
    ASSERT_GT(fragments.size(), 5000u);
    for (const Fragment& f : fragments) {
      const double cosine = std::max(0.0, Dot(f.normal, scene.lights[0].direction));
      ASSERT_NEAR(f.radiance[0], rho * cosine, 0.004 * rho) << f.x << ", " << f.y;
    }
  }
}

// A value that depends on both azimuths tells a mirrored, swapped or turned tangent frame. Points,
// frames and pixels are those of the torus' own formulas, not of the mesh.
TEST_F(SceneRendererTest, TheTangentFrameCarriesTheSampleFrame) {
  const auto value = [](Vec3 v, Vec3 l) {
    return l.z * (1 + 0.5 * l.x - 0.3 * l.y) * (1 + 0.4 * v.x + 0.2 * v.y);
  };
  const BtfSource source = Source(MakeBtf(2, 2, 20, Rings(RadFromDeg(85), RadFromDeg(32)),
                                          Rings(RadFromDeg(85), RadFromDeg(16)),
                                          [&](int, int, Vec3 v, Vec3 l) { return value(v, l); }));
  for (const Vec3& light : kLights) {
    Scene scene = TorusScene(light);
    scene.objects[0].position_mm = {3, 2, -4};
    scene.objects[0].rotation_rad = {0.3, -0.2, 0.9};
    const RigidTransform place = Placement(scene.objects[0]);
    std::map<std::pair<int, int>, Fragment> at;
    for (const Fragment& f : Probe(scene, source)) at[{f.x, f.y}] = f;
    int compared = 0;
    for (int i = 0; i < 4000; ++i) {
      const double theta = 2.4 * i, phi = 0.37 * i;
      const Vec3 outwards{std::cos(theta), std::sin(theta), 0};
      const Vec3 n = std::cos(phi) * outwards + Vec3{0, 0, std::sin(phi)};
      const Vec3 p = place * (50 * outwards + 22 * n);
      const Vec3 normal = place.rotation * n;
      const Vec3 tangent = place.rotation * Vec3{-std::sin(theta), std::cos(theta), 0};
      const Vec3 along_y = place.rotation * (-std::sin(phi) * outwards + Vec3{0, 0, std::cos(phi)});
      const auto pixel = PixelOf(scene.camera, scene.image.width, scene.image.height, p);
      const auto found = at.find({static_cast<int>(pixel[0]), static_cast<int>(pixel[1])});
      if (found == at.end()) continue;
      const Fragment& f = found->second;
      const Vec3 eye = Normalized(scene.camera.eye_mm - p);
      if (Dot(eye, normal) < 0.25 || Dot(f.normal, normal) < 0.9995) continue;  // hidden, grazing
      const Vec3 v = {Dot(eye, tangent), Dot(eye, along_y), Dot(eye, normal)};
      const Vec3 s = scene.lights[0].direction;
      const Vec3 l = {Dot(s, tangent), Dot(s, along_y), Dot(s, normal)};
      ASSERT_LT(Norm(f.view - v), 0.12);
      if (l.z < 0.15) continue;
      ASSERT_NEAR(f.radiance[0], kPi * value(v, l), 0.15 * kPi * value(v, l) + 0.08);
      ++compared;
    }
    EXPECT_GT(compared, 300);
  }
}

// A letter F, seen from above with +y up: its stem on the left, its bars up.
TEST_F(SceneRendererTest, TheSampleLiesUprightAndUnmirrored) {
  const std::vector<std::string> letter = {"........", ".#####..", ".#......", ".####...",
                                           ".#......", ".#......", ".#......", "........"};
  const auto is_ink = [&](int x, int y) {
    return letter[static_cast<size_t>(y)][static_cast<size_t>(x)] == '#';
  };
  const double pitch = 60.0 / 8;
  const BtfSource source =
      Source(MakeBtf(8, 8, pitch, {{0, 0, 1}}, {{0, 0, 1}},
                     [&](int x, int y, Vec3, Vec3) { return is_ink(x, y) ? 0.3 : 0.1; }));
  for (const Material material : {Material::kBtf, Material::kPlain}) {
    Scene scene = SlabFromAboveScene({0, 0, 1});
    scene.objects[0].material = material;
    std::map<std::pair<int, int>, Fragment> at;
    for (const Fragment& f : Probe(scene, source)) at[{f.x, f.y}] = f;
    for (int j = 0; j < 8; ++j) {
      for (int i = 0; i < 8; ++i) {  // the texel's centre by the file format's own formula
        const Vec3 p{(i + 0.5 - 4) * pitch, (4 - j - 0.5) * pitch, 5};
        const auto pixel = PixelOf(scene.camera, scene.image.width, scene.image.height, p);
        const auto found = at.find({static_cast<int>(pixel[0]), static_cast<int>(pixel[1])});
        ASSERT_NE(found, at.end());
        EXPECT_NEAR(found->second.radiance[0], kPi * (is_ink(i, j) ? 0.3 : 0.1), 0.08)
            << "texel " << i << ", " << j;
      }
    }
    // Row 0 of the texture is the upper edge of the picture.
    const auto top = PixelOf(scene.camera, scene.image.width, scene.image.height, {0, 25, 5});
    EXPECT_LT(top[1], scene.image.height / 2.0);
  }
}

TEST_F(SceneRendererTest, AgreesWithTheCpuOnAnUncompressedBtf) {
  btf::SampledBtf btf = MakeBumpyBtf(16, Rings(RadFromDeg(70), RadFromDeg(25)),
                                     Rings(RadFromDeg(70), RadFromDeg(25)));
  for (int i = 0; i < 40; ++i) btf.SetPresent(i % btf.header().view_count(), (i * 7) % 11, false);
  const BtfSource source = Source(std::move(btf));
  for (Scene scene : {SlabFromAboveScene({1, 1, 2}), TorusScene({1, -0.5, 1})}) {
    scene.lights.push_back({Normalized({-2, 0.3, 1}), {1, 2, 0.5}});
    const auto fragments = Probe(scene, source);
    const CpuCheck check = CompareWithCpu(scene, source, fragments, 1500);
    EXPECT_EQ(check.fragments, 1500u);
    EXPECT_LT(check.rel_error, 1e-3);
    EXPECT_LT(check.max_abs, 1e-2);
    // Head-on, in the middle of the slab.
    for (const Fragment& f : fragments) {
      if (f.x != 120 || f.y != 90) continue;
      const auto cpu = CpuRadiance(scene, source, f);
      for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(f.radiance[c], cpu[c], 1e-3);
    }
  }
}

struct Setting {
  const codecs::Encoder* encoder;
  codecs::Weighting weighting;
  bool clamp_negative = false;
};

// Every codec, once more clamped at zero, and with its decoded values under an exponential where it can.
std::vector<Setting> EverySetting() {
  std::vector<Setting> settings;
  for (const codecs::Encoder* encoder : codecs::AllEncoders()) {
    settings.push_back({encoder, codecs::Weighting::kLinear});
    settings.push_back({encoder, codecs::Weighting::kLinear, true});
    if ((encoder->options() & codecs::kLogWeighting) != 0) {
      settings.push_back({encoder, codecs::Weighting::kLog});
    }
  }
  return settings;
}

// Every codec there is, through its own shader or as decoded images.
TEST_F(SceneRendererTest, AgreesWithTheCpuOnEveryCodec) {
  btf::SampledBtf btf = MakeBumpyBtf(16, Rings(RadFromDeg(70), RadFromDeg(25)),
                                     Rings(RadFromDeg(70), RadFromDeg(25)));
  for (const bool holes : {false, true}) {
    for (int i = 0; holes && i < 40; ++i) {
      btf.SetPresent(i % btf.header().view_count(), (i * 7) % 11, false);
    }
    for (const auto& [encoder, weighting, clamp] : EverySetting()) {
      if (clamp && !holes) continue;
      SCOPED_TRACE(fmt::format("{}, {}{}{}", encoder->name(), codecs::NameOf(weighting),
                               clamp ? ", clamped" : "", holes ? " with absent pairs" : ""));
      codecs::EncodeOptions options;
      options.weighting = weighting;
      options.clamp_negative = clamp;
      auto encoded = EncodeBtf(*encoder, btf, options);
      if (absl::IsInvalidArgument(encoded.status())) continue;  // not for BTFs of many views
      ASSERT_TRUE(encoded.ok()) << encoded.status();
      auto source = BtfSource::FromEncoded(*std::move(encoded));
      ASSERT_TRUE(source.ok()) << source.status();
      const Scene scene = TorusScene({1, -0.5, 1});
      const auto fragments = Probe(scene, *source);
      // Without a shader of its own a codec is drawn from its decoded images.
      const BtfSource decoded = Source(codecs::DecodeAll(*source->encoded()));
      const bool own = source->encoded()->ToShader().has_value();
      const CpuCheck check = CompareWithCpu(scene, own ? *source : decoded, fragments, 1500);
      EXPECT_EQ(check.fragments, 1500u);
      EXPECT_LT(check.rel_error, 1e-3);
      EXPECT_LT(check.max_abs, 1e-2);
    }
  }
}

TEST_F(SceneRendererTest, BelowTheHorizonIsBlackAndBeyondTheConeIsScaled) {
  const BtfSource source = Source(MakeBtf(2, 2, 20, {{0, 0, 1}}, Rings(0.5, 0.1),
                                          [](int, int, Vec3, Vec3 l) { return 0.3 * l.z; }));
  const Scene scene = TorusScene({1, 0, 0.3});
  int dark = 0;
  for (const Fragment& f : Probe(scene, source)) {
    const double cosine = Dot(f.normal, scene.lights[0].direction);
    ASSERT_NEAR(f.radiance[0], kPi * 0.3 * std::max(0.0, cosine), 0.005);
    if (cosine < 0) ++dark;
  }
  EXPECT_GT(dark, 500);
}

TEST_F(SceneRendererTest, PlainIsLambertOfTheFrontalView) {
  const BtfSource source = Source(
      MakeBtf(4, 4, 20, {DirectionFromAngles(0.7, 1), DirectionFromAngles(0.1, 2)}, Rings(1.2, 0.3),
              [](int, int, Vec3 v, Vec3 l) { return (v.z > 0.9 ? 0.2 : 9.0) * l.z; }));
  Scene scene = TorusScene({-1, 1, 1});
  scene.objects[0].material = Material::kPlain;
  for (const Fragment& f : Probe(scene, source)) {
    const double cosine = std::max(0.0, Dot(f.normal, scene.lights[0].direction));
    ASSERT_NEAR(f.radiance[1], kPi * 0.2 * 0.8 * cosine, 2e-3);
  }
}

TEST_F(SceneRendererTest, TooManyImagesAreRefusedWithTheLimit) {
  std::vector<Vec3> lights;
  for (int i = 0; i < 130; ++i) lights.push_back(DirectionFromAngles(0.01 * i, 0.7 * i));
  const int views = context_->limits().array_layers / 130 + 1;
  std::vector<Vec3> many(lights.begin(), lights.begin() + views);
  const BtfSource source =
      Source(MakeBtf(1, 1, 1, many, lights, [](int, int, Vec3, Vec3) { return 0.1; }));
  const auto renderer = SceneRenderer::Create(TorusScene({0, 0, 1}), source, *context_);
  ASSERT_FALSE(renderer.ok());
  EXPECT_EQ(renderer.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(Message(renderer.status())),
              testing::AllOf(HasSubstr(fmt::format("{}", context_->limits().array_layers)),
                             HasSubstr("compress")));
}

TEST_F(SceneRendererTest, PicturesRepeatAndAreAntialiased) {
  const BtfSource source = Source(MakeBumpyBtf(16, Rings(RadFromDeg(60), RadFromDeg(30)),
                                               Rings(RadFromDeg(60), RadFromDeg(30))));
  Scene scene = TorusScene({1, -1, 1});
  scene.image.background_top = scene.image.background_bottom = {1, 0, 0};
  const auto draw = [&](int msaa, int supersample) {
    scene.image.msaa = msaa;
    scene.image.supersample = supersample;
    auto renderer = SceneRenderer::Create(scene, source, *context_);
    EXPECT_TRUE(renderer.ok()) << renderer.status();
    renderer->Draw();
    const auto first = renderer->ReadPicture();
    renderer->Draw();
    const auto second = renderer->ReadPicture();
    EXPECT_EQ(first->rgb, second->rgb);
    return *first;
  };
  // Pixels of mixed colour along the silhouette; the torus itself is never saturated red.
  const auto mixed = [](const Picture& picture) {
    int count = 0;
    for (size_t i = 0; i < picture.rgb.size(); i += 3) {
      const int excess = picture.rgb[i] - picture.rgb[i + 1];
      if (excess > 100 && picture.rgb[i] < 253) ++count;
    }
    return count;
  };
  const int jagged = mixed(draw(1, 1)), msaa = mixed(draw(4, 1)), supersampled = mixed(draw(1, 2));
  EXPECT_GT(msaa, jagged + 100);
  EXPECT_GT(supersampled, jagged + 100);
}

}  // namespace
}  // namespace mesorig::renderer
