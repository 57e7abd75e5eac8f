// Silhouettes from the exact MDF of a height field against the same height field, displaced and
// traced.

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>

#include "renderer/gl/scene_renderer.h"
#include "renderer/tracer/silhouette_figures.h"
#include "renderer/tracer/tracer.h"
#include "tests/renderer/gl/domes.h"
#include "tests/renderer/gl/synthetic.h"

namespace mesorig::renderer {
namespace {

Scene ReliefTorus() {
  Scene scene = TorusScene({0.3, -0.5, 1});
  Object& torus = scene.objects[0];
  torus.material = Material::kBtfMdf;
  torus.major_radius_mm = 46;
  torus.minor_radius_mm = 23;
  torus.mm_per_unit = 40;
  torus.whole_repeats = true;
  torus.rotation_rad = {0.2, 0.1, 0};
  scene.image.width = 400;
  scene.image.height = 300;
  return scene;
}

class SilhouetteTruthTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = GlContext::Create();
    if (!context.ok()) GTEST_SKIP() << context.status();
    context_.emplace(*std::move(context));
  }
  std::vector<uint8_t> Traced(const Scene& scene, const HeightFunction& height, double edge_mm) {
    std::vector<SurfaceMesh> surfaces;
    for (const Object& object : scene.objects) {
      surfaces.push_back(*DisplaceSurface(object, *ScaleTexture(object, kDomesSize, 1),
                                          {kDomesSize, kDomesSize}, height, edge_mm));
    }
    return Tracer::Create(std::move(surfaces))->Mask(scene);
  }
  std::vector<uint8_t> Drawn(const Scene& scene, const btf::Mdf& mdf) {
    auto source = BtfSource::FromSampled(MakeBtf(1, 1, kDomesSize, {{0, 0, 1}}, {{0, 0, 1}},
                                                 [](int, int, Vec3, Vec3 l) { return 0.2 * l.z; }));
    auto renderer = SceneRenderer::Create(scene, *source, *context_, &mdf);
    EXPECT_TRUE(renderer.ok()) << renderer.status();
    std::vector<uint8_t> mask(static_cast<size_t>(scene.image.width * scene.image.height));
    const auto fragments = renderer->Probe();
    for (const Fragment& f : *fragments) {
      mask[static_cast<size_t>(f.y * scene.image.width + f.x)] = 1;
    }
    return mask;
  }
  std::optional<GlContext> context_;
};

TEST_F(SilhouetteTruthTest, TheReliefsSilhouetteIsSeen) {
  Scene scene = ReliefTorus();
  const auto base = Traced(scene, nullptr, 1000);
  const auto shrunk = Traced(
      scene, [](double, double) { return kDomesLowest - kDomesReference; }, 1000);
  const auto truth = Traced(
      scene, [](double x, double y) { return DomesHeight(x, y) - kDomesReference; }, 0.5);
  const auto iou = [&](const std::vector<uint8_t>& drawn) {
    const auto figures = CompareInBand(base, shrunk, truth, drawn);
    EXPECT_TRUE(figures.ok()) << figures.status();
    return figures->iou;
  };
  const double btf_only = iou(base);
  const btf::Mdf mdf = DomesMdf(48, Rings(RadFromDeg(75), RadFromDeg(12)));
  const double with_mdf = iou(Drawn(scene, mdf));
  scene.silhouettes.follow_curvature = false;
  const double straight = iou(Drawn(scene, mdf));
  RecordProperty("iou", fmt::format("btf {} straight {} mdf {}", btf_only, straight, with_mdf));
  EXPECT_GT(straight, btf_only + 0.15);
  EXPECT_GT(with_mdf, straight + 0.08);
  EXPECT_GT(with_mdf, 0.75);
}

}  // namespace
}  // namespace mesorig::renderer
