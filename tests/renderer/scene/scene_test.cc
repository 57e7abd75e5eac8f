#include "renderer/scene/scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "protocol/base/file_writer.h"
#include "renderer/scene/mesh.h"
#include "renderer/scene/view_transform.h"
#include "tests/fixtures/damaged_text.h"

namespace mesorig::renderer {
namespace {

using testing::HasSubstr;

constexpr char kScene[] = R"(btf = "data/weave.btf.exr"
[image]
width_px = 640
height_px = 360
exposure = 1.5
[camera]
eye_mm = [0, -200, 150]
fov_deg = 25
[[light]]
direction = [0, 3, 4]
[[object]]
shape = "torus"
major_radius_mm = 50
minor_radius_mm = 20
[[object]]
shape = "slab"
material = "plain"
size_mm = [80, 80, 10]
rounding_mm = 3
rotation_deg = [0, 0, 90]
)";

StatusOr<Scene> Parse(std::string_view text) { return ParseScene(text, "s.toml", "/scenes"); }

// The scene with `from` replaced by `to`.
std::string Changed(std::string_view from, std::string_view to) {
  std::string text = kScene;
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(SceneTest, ReadsAScene) {
  const auto scene = Parse(kScene);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->btf_file, "/scenes/data/weave.btf.exr");
  EXPECT_EQ(scene->image.width, 640);
  EXPECT_EQ(scene->image.msaa, 4);
  EXPECT_DOUBLE_EQ(scene->image.exposure, 1.5);
  EXPECT_NEAR(scene->camera.fov_rad, RadFromDeg(25), 1e-12);
  ASSERT_EQ(scene->lights.size(), 1u);
  EXPECT_NEAR(scene->lights[0].direction.z, 0.8, 1e-12);
  ASSERT_EQ(scene->objects.size(), 2u);
  EXPECT_TRUE(scene->objects[0].whole_repeats);
  EXPECT_TRUE(scene->Uses(Material::kBtf));
  EXPECT_TRUE(scene->Uses(Material::kPlain));
  const Vec3 x = Placement(scene->objects[1]).rotation * Vec3{1, 0, 0};
  EXPECT_NEAR(x.y, 1, 1e-12);
}

TEST(SceneTest, ErrorsNameFileLineAndColumn) {
  const struct {
    const char *from, *to, *where, *what;
  } cases[] = {
      {"exposure = 1.5", "exposre = 1.5", "s.toml:5:1", "exposre"},
      {"width_px = 640", "width_px = 3", "s.toml:3:", "3"},
      {"fov_deg = 25", "fov_deg = \"wide\"", "s.toml:8:", "fov_deg"},
      {"[0, -200, 150]", "[0, 0, 0]", "s.toml:7:", "target_mm"},
      {"[0, 3, 4]", "[0, 0, 0]", "s.toml:10:", "zero"},
      {"\"torus\"", "\"teapot\"", "s.toml:12:", "teapot"},
      {"minor_radius_mm = 20", "minor_radius_mm = 60", "s.toml:14:", "below major_radius_mm"},
      {"rounding_mm = 3", "rounding_mm = 6", "s.toml:19:", "half of the smallest size"},
      {"rounding_mm = 3", "major_radius_mm = 3", "s.toml:19:", "major_radius_mm"},
      {"[image]", "[image", "s.toml:2:", ""},
  };
  for (const auto& c : cases) {
    const auto scene = Parse(Changed(c.from, c.to));
    ASSERT_FALSE(scene.ok()) << c.to;
    EXPECT_EQ(scene.status().code(), absl::StatusCode::kInvalidArgument);
    const std::string message(Message(scene.status()));
    EXPECT_THAT(message, HasSubstr(c.where)) << c.to;
    EXPECT_THAT(message, HasSubstr(c.what)) << c.to;
  }
}

TEST(SceneTest, ReadsSilhouettes) {
  const auto plain = Parse(kScene);
  ASSERT_TRUE(plain.ok());
  EXPECT_TRUE(plain->mdf_file.empty());
  EXPECT_FALSE(plain->Uses(Material::kBtfMdf));
  EXPECT_EQ(plain->silhouettes.max_passes, 8);
  EXPECT_TRUE(plain->silhouettes.follow_curvature);
  EXPECT_LT(plain->silhouettes.step_mm, 0);
  std::string text = Changed("material = \"plain\"", "material = \"btf+mdf\"");
  text = "mdf = \"../m.mdf.exr\"\n" + text +
         "[silhouettes]\nmax_passes = 3\nfollow_curvature = false\nstep_mm = 0.5\n";
  const auto scene = Parse(text);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->mdf_file, "/m.mdf.exr");
  EXPECT_EQ(scene->objects[1].material, Material::kBtfMdf);
  EXPECT_EQ(scene->silhouettes.max_passes, 3);
  EXPECT_FALSE(scene->silhouettes.follow_curvature);
  EXPECT_DOUBLE_EQ(scene->silhouettes.step_mm, 0.5);
  for (const char* bad : {"max_passes = 0", "max_passes = 65", "max_passes = 1.5", "step_mm = -1",
                          "step_mm = nan", "follow_curvature = 1", "passes = 3"}) {
    const auto refused = Parse(std::string(kScene) + "[silhouettes]\n" + bad + "\n");
    ASSERT_FALSE(refused.ok()) << bad;
    EXPECT_THAT(std::string(Message(refused.status())), HasSubstr("s.toml:22:")) << bad;
  }
  EXPECT_FALSE(Parse(Changed("material = \"plain\"", "material = \"mdf\"")).ok());
  EXPECT_FALSE(Parse("mdf = 3\n" + std::string(kScene)).ok());
}

TEST(SceneTest, NeedsALightAndAnObject) {
  EXPECT_FALSE(Parse("[camera]\neye_mm = [0, 0, 9]\nup = [0, 1, 0]\n").ok());
  EXPECT_EQ(LoadScene("/nowhere.toml").status().code(), absl::StatusCode::kNotFound);
}

TEST(SceneTest, GarbageIsRefusedAndNeverCrashes) {
  std::mt19937 random(7);
  int refused = 0;
  for (int i = 0; i < 3000; ++i) {
    const int edits = 1 + static_cast<int>(random() % 4);
    const std::string text = test::Damaged(kScene, random, edits, "[]={}\"\n.-9e");
    const auto scene = Parse(text);
    if (!scene.ok()) {
      ++refused;
      ASSERT_FALSE(Message(scene.status()).empty()) << text;
      continue;
    }
    for (const Object& object : scene->objects) (void)Placement(object);
  }
  EXPECT_GT(refused, 1000);
}

TEST(SceneTest, ShippedScenesAreValid) {
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(MESORIG_SOURCE_DIR "/scenes")) {
    if (entry.path().extension() != ".toml") continue;
    const auto scene = LoadScene(entry.path());
    EXPECT_TRUE(scene.ok()) << scene.status();
    ++count;
  }
  EXPECT_GE(count, 4);
}

// Golden: camera at (0, 0, 100) looking down, up +y, 90 degrees high: the picture's upper edge is
// 100 mm from the centre.
TEST(ViewTransformTest, PixelOfAPoint) {
  Camera camera;
  camera.eye_mm = {0, 0, 100};
  camera.up = {0, 1, 0};
  camera.fov_rad = RadFromDeg(90);
  const auto pixel = PixelOf(camera, 400, 200, {50, 25, 0});
  EXPECT_NEAR(pixel[0], 250, 1e-9);
  EXPECT_NEAR(pixel[1], 75, 1e-9);
}

}  // namespace
}  // namespace mesorig::renderer
