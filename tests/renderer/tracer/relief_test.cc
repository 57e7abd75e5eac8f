#include "renderer/tracer/relief.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "protocol/base/file_writer.h"
#include "tests/fixtures/damaged_text.h"

namespace mesorig::renderer {
namespace {

using testing::HasSubstr;

// A roof over 10 x 10 mm: its ridge, 3 mm high, runs along y at x = 1.
constexpr char kRoof[] = R"(# a roof
o roof
v -5 -5 1
v 1 -5 3
v 5 -5 1
v -5 5 1
v 1 5 3.0
v 5 5 1e0
vn 0 0 1
f 1 2 5
f 1/1 5/2/1 4//1
f -5 -4 -1
f 2 6 5
)";

StatusOr<ReliefMesh> Parse(std::string_view text) { return ParseRelief(text, "r.obj"); }

TEST(ReliefTest, ReadsTrianglesAndHeights) {
  const auto mesh = Parse(kRoof);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_EQ(mesh->vertices.size(), 6u);
  EXPECT_EQ(mesh->triangles.size(), 4u);
  EXPECT_EQ(mesh->triangles[2], (std::array<uint32_t, 3>{1, 2, 5}));
  const auto relief = Relief::Create(*mesh, 8, 8);
  ASSERT_TRUE(relief.ok()) << relief.status();
  EXPECT_NEAR(relief->HeightAt(1, 2), 3, 1e-4);
  EXPECT_NEAR(relief->HeightAt(-2, -3), 2, 1e-4);
  EXPECT_NEAR(relief->HeightAt(3, 0), 2, 1e-4);
  EXPECT_NEAR(relief->highest_mm(), 3, 0.05);       // to the grid that is looked at
  EXPECT_NEAR(relief->lowest_mm(), 4.0 / 3, 0.05);  // at x = -4
  EXPECT_NEAR(relief->HeightAt(30, 0), relief->lowest_mm(), 1e-9);
}

TEST(ReliefTest, OfTwoSurfacesTheHigherCounts) {
  const auto mesh = Parse(
      "v -9 -9 0\nv 9 -9 0\nv 0 9 0\nv -9 -9 2\nv 9 -9 2\nv 0 9 2\n"
      "f 1 2 3\nf 4 5 6\n");
  ASSERT_TRUE(mesh.ok());
  const auto relief = Relief::Create(*mesh, 4, 4);
  ASSERT_TRUE(relief.ok());
  EXPECT_NEAR(relief->HeightAt(0, 0), 2, 1e-5);
  EXPECT_NEAR(relief->lowest_mm(), 2, 1e-5);
}

TEST(ReliefTest, ErrorsNameFileAndLine) {
  const struct {
    std::string text, where;
  } cases[] = {
      {"v 1 2\n", "r.obj:1"},
      {"v 1 2 nan\n", "r.obj:1"},
      {"v 1 2 inf\n", "r.obj:1"},
      {"v 1 2 1e9\n", "r.obj:1"},
      {"v 1 2 x\n", "r.obj:1"},
      {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "r.obj:4"},
      {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "r.obj:4"},
      {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 1 2\n", "r.obj:4"},
      {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "r.obj:4"},
      {"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3 4\n", "r.obj:5"},
      {"v 0 0 0\nply\n", "r.obj:2"},
      {"v 0 0 0\n", "no triangles"},
      {"", "no triangles"},
  };
  for (const auto& c : cases) {
    const auto mesh = Parse(c.text);
    ASSERT_FALSE(mesh.ok()) << c.text;
    EXPECT_EQ(mesh.status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(Message(mesh.status())), HasSubstr(c.where)) << c.text;
  }
  EXPECT_EQ(ReadRelief("/nowhere.obj").status().code(), absl::StatusCode::kNotFound);
  const auto elsewhere = Parse("v 90 90 1\nv 91 90 1\nv 90 91 1\nf 1 2 3\n");
  ASSERT_TRUE(elsewhere.ok());
  EXPECT_EQ(Relief::Create(*elsewhere, 4, 4).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(ReliefTest, HostileBytesAreRefusedOrReadAndNeverCrash) {
  std::mt19937 random(3);
  int refused = 0, read = 0;
  for (int i = 0; i < 4000; ++i) {
    std::string text = kRoof;
    if (random() % 4 == 0) text.resize(random() % text.size());
    text = test::Damaged(text, random, static_cast<int>(random() % 4), "0123456789-./ efnv\n");
    const auto mesh = Parse(text);
    if (!mesh.ok()) {
      ++refused;
      ASSERT_FALSE(Message(mesh.status()).empty());
      continue;
    }
    ++read;
    for (const auto& triangle : mesh->triangles) {
      for (uint32_t corner : triangle) ASSERT_LT(corner, mesh->vertices.size());
    }
    for (const auto& vertex : mesh->vertices) {
      for (float coordinate : vertex) ASSERT_LE(std::abs(coordinate), 1e6f);
    }
  }
  EXPECT_GT(refused, 500);
  EXPECT_GT(read, 500);
}

}  // namespace
}  // namespace mesorig::renderer
