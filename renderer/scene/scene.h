#pragma once
// What to render, as read from a scene file (`scenes/*.toml`). World frame of the scene:
// right-handed, millimetres, z up. Directions of lights point towards the light. Plain values;
// all functions are reentrant.

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"

namespace mesorig::renderer {

inline constexpr int kMaxLights = 4;

struct ImageSettings {
  int width = 960, height = 540;  // pixels of the picture
  int msaa = 4;                   // samples a pixel along silhouettes: 1 or 4
  int supersample = 1;            // shaded samples a pixel and axis, averaged: 1..4
  double exposure = 1;  // picture = sRGB(exposure * radiance); 1 shows radiance 1 as white
  Vec3 background_top{0.30, 0.32, 0.35};  // linear RGB of the finished picture
  Vec3 background_bottom{0.06, 0.06, 0.07};
};

struct Camera {
  Vec3 eye_mm, target_mm;
  Vec3 up{0, 0, 1};
  double fov_rad = 0;  // vertical
};

struct DirectionalLight {
  Vec3 direction;                  // unit vector towards the light
  Vec3 irradiance{kPi, kPi, kPi};  // of a plane perpendicular to it, W m^-2, linear RGB
};

enum class Shape { kTorus, kSlab };
// kBtf: the BTF, both directions per fragment. kBtfMdf: the same, with the silhouettes of the
// mesostructure (Wang et al. 2005, Sec. 4.1). kPlain: the Lambert fit of the BTF's most frontal
// view as a texture, which is what one has without a BTF.
enum class Material { kBtf, kBtfMdf, kPlain };

// How the rays of kBtfMdf objects are followed (gl/silhouettes.h says what each does).
struct SilhouetteSettings {
  int max_passes = 8;            // layers of an object peeled at most; 1..64
  bool follow_curvature = true;  // false: the straight rays of Wang et al.
  // Depths that differ by more are different layers of the mesostructure and are never averaged,
  // mm of the sample; 0: nearest texel and nearest view; negative: two texels' pitch.
  double step_mm = -1;
};

struct Object {
  Shape shape = Shape::kSlab;
  Material material = Material::kBtf;
  Vec3 position_mm;
  Vec3 rotation_rad;  // about x, then y, then z of the world
  // Torus: lies in the xy plane, axis z.
  double major_radius_mm = 0, minor_radius_mm = 0;
  // Slab: a box; its top faces +z. Rounding 0: sharp edges.
  Vec3 size_mm;
  double rounding_mm = 0;
  // Millimetres of the surface that one texture unit covers: one repeat of the sample, across its
  // width. 0: the sample's true width.
  double mm_per_unit = 0;
  // Stretches the texture so that whole repeats go around (torus): no seam.
  bool whole_repeats = false;
};

struct Scene {
  // Resolved against the scene file's folder; empty: none named.
  std::filesystem::path btf_file, mdf_file;
  ImageSettings image;
  SilhouetteSettings silhouettes;
  Camera camera;
  std::vector<DirectionalLight> lights;  // 1..kMaxLights
  std::vector<Object> objects;           // at least one
  bool Uses(Material material) const;
};

// NotFound; InvalidArgument with file:line:column for a syntax error, an unknown key, a missing or
// out-of-range value.
StatusOr<Scene> LoadScene(const std::filesystem::path& path);
// The same from text; `name` stands for the file in messages, relative paths hang on `folder`.
StatusOr<Scene> ParseScene(std::string_view text, std::string_view name,
                           const std::filesystem::path& folder);

}  // namespace mesorig::renderer
