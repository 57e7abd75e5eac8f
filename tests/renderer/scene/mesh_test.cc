#include "renderer/scene/mesh.h"

#include <gtest/gtest.h>

#include <map>

namespace mesorig::renderer {
namespace {

Vec3 At(const float (&v)[3]) { return {v[0], v[1], v[2]}; }

struct Named {
  const char* name;
  Mesh mesh;
  double volume_mm3;
};
std::vector<Named> AllMeshes() {
  // Rounded: the inner box 52 x 32 x 12, its faces 4 thick, quarter cylinders, corners.
  const double rounded = 52 * 32 * 12 + 2 * 4 * (52 * 32 + 52 * 12 + 32 * 12) +
                         kPi * 16 * (52 + 32 + 12) + 4 * kPi / 3 * 64;
  return {{"torus", MakeTorus(50, 20, 128, 64), 2 * kPi * kPi * 50 * 400},
          {"sharp slab", MakeSlab({60, 40, 20}, 0), 60 * 40 * 20},
          {"rounded slab", MakeSlab({60, 40, 20}, 4), rounded}};
}

// For every triangle: what the texture coordinates say of +x and +y is what the vertices' frames
// say, lengths are those of the surface, and the outside is outside.
TEST(MeshTest, FramesFollowTheTextureAndAreRightHanded) {
  for (const Named& named : AllMeshes()) {
    SCOPED_TRACE(named.name);
    const Mesh& mesh = named.mesh;
    for (size_t i = 0; i < mesh.indices.size(); i += 3) {
      const Vertex& a = mesh.vertices[mesh.indices[i]];
      const Vertex& b = mesh.vertices[mesh.indices[i + 1]];
      const Vertex& c = mesh.vertices[mesh.indices[i + 2]];
      const Vec3 ab = At(b.position) - At(a.position), ac = At(c.position) - At(a.position);
      const double x1 = b.texture_mm[0] - a.texture_mm[0], y1 = b.texture_mm[1] - a.texture_mm[1];
      const double x2 = c.texture_mm[0] - a.texture_mm[0], y2 = c.texture_mm[1] - a.texture_mm[1];
      const double area = x1 * y2 - x2 * y1;
      ASSERT_GT(area, 0) << "mirrored texture at triangle " << i / 3;
      const Vec3 along_x = (1 / area) * (y2 * ab - y1 * ac);
      const Vec3 along_y = (1 / area) * (x1 * ac - x2 * ab);
      const Vec3 normal = At(a.normal), tangent = At(a.tangent);
      // (On the slab's spherical corners the grid shears by up to 30 degrees.)
      ASSERT_GT(Dot(Normalized(along_x), tangent), 0.85);
      ASSERT_GT(Dot(Normalized(along_y), Cross(normal, tangent)), 0.85);
      ASSERT_GT(Dot(Normalized(Cross(ab, ac)), normal), 0.95);
      ASSERT_GT(Norm(along_x), 0.55);
      ASSERT_LT(Norm(along_x), 1.45);
      ASSERT_NEAR(Norm(normal), 1, 1e-5);
      ASSERT_NEAR(Dot(normal, tangent), 0, 1e-5);
    }
  }
}

TEST(MeshTest, SurfacesAreClosed) {
  for (const Named& named : AllMeshes()) {
    SCOPED_TRACE(named.name);
    double volume = 0;  // divergence theorem
    std::map<std::array<long, 3>, int> ids;
    std::map<std::pair<int, int>, int> edges;
    const auto id = [&](const Vertex& v) {
      const std::array<long, 3> key = {std::lround(v.position[0] * 1000),
                                       std::lround(v.position[1] * 1000),
                                       std::lround(v.position[2] * 1000)};
      return ids.emplace(key, static_cast<int>(ids.size())).first->second;
    };
    const auto& vertices = named.mesh.vertices;
    for (size_t i = 0; i < named.mesh.indices.size(); i += 3) {
      const Vertex* v[3];
      for (size_t k = 0; k < 3; ++k) v[k] = &vertices[named.mesh.indices[i + k]];
      volume += Dot(At(v[0]->position), Cross(At(v[1]->position), At(v[2]->position))) / 6;
      for (size_t k = 0; k < 3; ++k) ++edges[{id(*v[k]), id(*v[(k + 1) % 3])}];
    }
    for (const auto& [edge, count] : edges) {
      if (edge.first == edge.second) continue;
      ASSERT_EQ((edges[{edge.second, edge.first}]), count);
    }
    EXPECT_NEAR(volume / named.volume_mm3, 1, 0.005);
  }
}

TEST(MeshTest, TheTopOfASlabLiesUprightAroundItsCentre) {
  for (const Vertex& v : MakeSlab({60, 40, 20}, 0).vertices) {
    if (v.normal[2] < 0.5f) continue;
    EXPECT_FLOAT_EQ(v.position[0], v.texture_mm[0]);
    EXPECT_FLOAT_EQ(v.position[1], v.texture_mm[1]);
  }
}

// On a torus d(surface)/d(texture) is (1 + (r/R) cos phi) along it and 1 around it. (At the seams
// the triangles of one side only count: half a segment, 0.044 rad.)
TEST(MeshTest, StretchOfATorusIsThatOfItsFormula) {
  const Mesh mesh = MakeTorus(50, 20, 144, 72);
  const std::vector<Stretch> stretch = StretchOf(mesh);
  ASSERT_EQ(stretch.size(), mesh.vertices.size());
  for (size_t i = 0; i < stretch.size(); ++i) {
    const Vertex& v = mesh.vertices[i];
    const double along = 1 + 0.4 * std::cos(v.texture_mm[1] / 20);
    const Vec3 normal = At(v.normal), tangent = At(v.tangent);
    ASSERT_LT(Norm(At(stretch[i].along_x) - along * tangent), 0.05);
    ASSERT_LT(Norm(At(stretch[i].along_y) - Cross(normal, tangent)), 0.05);
    ASSERT_NEAR(HeightScale(stretch[i]), std::sqrt(along), 0.02);
  }
}

TEST(MeshTest, StretchWithoutTextureAreaIsZero) {
  Mesh mesh = MakeSlab({10, 10, 10}, 5);  // a ball: some triangles have no area
  for (const Stretch& s : StretchOf(mesh)) {
    ASSERT_TRUE(std::isfinite(HeightScale(s)));
    ASSERT_GT(HeightScale(s), 0.3);
  }
  for (Vertex& v : mesh.vertices) v.texture_mm[0] = 3 * v.texture_mm[1];  // a line
  for (const Stretch& s : StretchOf(mesh)) {
    EXPECT_EQ(HeightScale(s), 0);
    EXPECT_EQ(Norm(At(s.along_x)), 0);
  }
  EXPECT_TRUE(StretchOf(Mesh()).empty());
}

TEST(MeshTest, TextureScale) {
  Object torus;
  torus.shape = Shape::kTorus;
  torus.major_radius_mm = 50;
  torus.minor_radius_mm = 20;
  torus.whole_repeats = true;
  const auto whole = ScaleTexture(torus, 40, 1);
  ASSERT_TRUE(whole.ok());
  EXPECT_NEAR(whole->x * 2 * kPi * 50, 8, 1e-9);  // 314.2 / 40 = 7.85
  EXPECT_NEAR(whole->y * 2 * kPi * 20, 3, 1e-9);  // 125.7 / 40 = 3.14
  Object slab;
  slab.mm_per_unit = 20;
  const auto scaled = ScaleTexture(slab, 40, 0.5);
  ASSERT_TRUE(scaled.ok());
  EXPECT_DOUBLE_EQ(scaled->x, 1.0 / 20);
  EXPECT_DOUBLE_EQ(scaled->y, 1.0 / 10);
  slab.mm_per_unit = 0;
  EXPECT_EQ(ScaleTexture(slab, 0, 1).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace mesorig::renderer
