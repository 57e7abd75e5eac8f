#include "renderer/scene/scene.h"

#include <algorithm>

#include "protocol/base/toml_reader.h"

namespace mesorig::renderer {
namespace {

ImageSettings ReadImage(TomlTable t) {
  ImageSettings image;
  image.width = static_cast<int>(t.IntegerOr("width_px", image.width, {8, 8192}));
  image.height = static_cast<int>(t.IntegerOr("height_px", image.height, {8, 8192}));
  image.msaa = static_cast<int>(t.IntegerOr("msaa", image.msaa, {1, 4}));
  if (image.msaa != 1 && image.msaa != 4) t.Error("msaa", "permitted is 1 or 4");
  image.supersample = static_cast<int>(t.IntegerOr("supersample", image.supersample, {1, 4}));
  image.exposure = t.NumberOr("exposure", image.exposure, {1e-6, 1e6});
  image.background_top = t.VectorOr("background_top", image.background_top, {0, 1});
  image.background_bottom = t.VectorOr("background_bottom", image.background_bottom, {0, 1});
  return image;
}

SilhouetteSettings ReadSilhouettes(TomlTable t) {
  SilhouetteSettings settings;
  settings.max_passes = static_cast<int>(t.IntegerOr("max_passes", settings.max_passes, {1, 64}));
  settings.follow_curvature = t.BoolOr("follow_curvature", settings.follow_curvature);
  if (t.Has("step_mm")) settings.step_mm = t.Number("step_mm", {0, 1e5});
  return settings;
}

Camera ReadCamera(TomlTable t) {
  Camera camera;
  camera.eye_mm = t.Vector("eye_mm", {-1e6, 1e6});
  camera.target_mm = t.VectorOr("target_mm", {}, {-1e6, 1e6});
  camera.up = t.VectorOr("up", camera.up, {-1, 1});
  camera.fov_rad = RadFromDeg(t.NumberOr("fov_deg", 30, {1, 120}));
  const Vec3 forward = Normalized(camera.target_mm - camera.eye_mm);
  if (Norm(forward) == 0) {
    t.Error("eye_mm", "is equal to target_mm: the camera looks nowhere");
  } else if (Norm(Cross(forward, Normalized(camera.up))) < 1e-6) {
    t.Error(t.Has("up") ? "up" : "eye_mm", "up is parallel to the viewing direction");
  }
  return camera;
}

DirectionalLight ReadLight(TomlTable t) {
  DirectionalLight light;
  const Vec3 direction = t.Vector("direction", {-1e6, 1e6});
  if (Norm(direction) == 0) t.Error("direction", "is zero: permitted is any other vector");
  light.direction = Normalized(direction);
  light.irradiance = t.VectorOr("irradiance", light.irradiance, {0, 1e6});
  return light;
}

void ReadTorus(TomlTable& t, Object& object) {
  object.major_radius_mm = t.Number("major_radius_mm", {0.01, 1e5});
  object.minor_radius_mm = t.Number("minor_radius_mm", {0.01, 1e5});
  if (object.minor_radius_mm >= object.major_radius_mm) {
    t.Error("minor_radius_mm", "must be below major_radius_mm");
  }
  object.whole_repeats = t.BoolOr("whole_repeats", true);
}

void ReadSlab(TomlTable& t, Object& object) {
  object.size_mm = t.Vector("size_mm", {0.01, 1e5});
  object.rounding_mm = t.NumberOr("rounding_mm", 0, {0, 1e5});
  const double smallest = std::min({object.size_mm.x, object.size_mm.y, object.size_mm.z});
  if (2 * object.rounding_mm > smallest) {
    t.Error("rounding_mm", fmt::format("is {} mm; permitted is at most half of the smallest size, "
                                       "{} mm",
                                       object.rounding_mm, smallest / 2));
  }
}

Object ReadObject(TomlTable t) {
  Object object;
  const std::string shape = t.Word("shape", {"torus", "slab"});
  if (t.Has("material")) {
    const std::string material = t.Word("material", {"btf", "btf+mdf", "plain"});
    if (material == "btf+mdf") object.material = Material::kBtfMdf;
    if (material == "plain") object.material = Material::kPlain;
  }
  object.position_mm = t.VectorOr("position_mm", {}, {-1e6, 1e6});
  object.rotation_rad = RadFromDeg(1) * t.VectorOr("rotation_deg", {}, {-360, 360});
  if (t.Has("mm_per_unit")) object.mm_per_unit = t.Number("mm_per_unit", {0.001, 1e5});
  if (shape == "torus") {
    object.shape = Shape::kTorus;
    ReadTorus(t, object);
  } else if (shape == "slab") {
    object.shape = Shape::kSlab;
    ReadSlab(t, object);
  }
  return object;
}

StatusOr<Scene> ReadScene(TomlFile file, const std::filesystem::path& folder) {
  TomlTable root = file.root();
  Scene scene;
  // (An absolute path stays as it is.)
  if (const std::string btf = root.StringOr("btf", ""); !btf.empty()) {
    scene.btf_file = (folder / btf).lexically_normal();
  }
  if (const std::string mdf = root.StringOr("mdf", ""); !mdf.empty()) {
    scene.mdf_file = (folder / mdf).lexically_normal();
  }
  if (auto image = root.TableIfPresent("image")) scene.image = ReadImage(*image);
  if (auto settings = root.TableIfPresent("silhouettes")) {
    scene.silhouettes = ReadSilhouettes(*settings);
  }
  scene.camera = ReadCamera(root.Table("camera"));
  for (TomlTable light : root.Tables("light")) scene.lights.push_back(ReadLight(light));
  if (scene.lights.empty() || scene.lights.size() > kMaxLights) {
    root.Error("light", fmt::format("has {} [[light]] tables; permitted is 1 to {}",
                                    scene.lights.size(), kMaxLights));
  }
  for (TomlTable object : root.Tables("object")) scene.objects.push_back(ReadObject(object));
  if (scene.objects.empty() || scene.objects.size() > 64) {
    root.Error("object",
               fmt::format("has {} [[object]] tables; permitted is 1 to 64", scene.objects.size()));
  }
  MESORIG_RETURN_IF_ERROR(file.Finish());
  return scene;
}

}  // namespace

bool Scene::Uses(Material material) const {
  return std::any_of(objects.begin(), objects.end(),
                     [&](const Object& object) { return object.material == material; });
}

StatusOr<Scene> LoadScene(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(TomlFile file, TomlFile::Load(path));
  return ReadScene(std::move(file), path.parent_path());
}

StatusOr<Scene> ParseScene(std::string_view text, std::string_view name,
                           const std::filesystem::path& folder) {
  MESORIG_ASSIGN_OR_RETURN(TomlFile file, TomlFile::Parse(text, name));
  return ReadScene(std::move(file), folder);
}

}  // namespace mesorig::renderer
