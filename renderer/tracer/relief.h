#pragma once
// The relief of a sample as a triangle mesh, and its height at a place: a height field, of which
// the highest point counts.

#include <filesystem>
#include <string_view>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"
#include "renderer/tracer/embree_scene.h"

namespace mesorig::renderer {

// Sample frame, mm.
struct ReliefMesh {
  std::vector<std::array<float, 3>> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;
};

// Wavefront OBJ of triangles: lines `v x y z` (mm, sample frame) and `f a b c` (numbers from 1, or
// from the end when negative; `a/b/c` with texture and normal numbers, which are ignored). Other
// keywords of the format, comments and empty lines are skipped. NotFound; InvalidArgument with
// file:line for a coordinate that is not a finite number within 1e6 mm, a face that is not a
// triangle of known vertices, a line that is none of these, and a file without triangles.
StatusOr<ReliefMesh> ReadRelief(const std::filesystem::path& path);
StatusOr<ReliefMesh> ParseRelief(std::string_view text, std::string_view name);

// Immutable; reentrant.
class Relief {
 public:
  // Of the part within width_mm x height_mm around the origin. Unavailable when Embree refuses;
  // InvalidArgument when the mesh has nothing there.
  static StatusOr<Relief> Create(const ReliefMesh& mesh, double width_mm, double height_mm);
  // Height at (x, y), mm; where the mesh has nothing, its lowest height.
  double HeightAt(double x_mm, double y_mm) const;
  double lowest_mm() const { return lowest_mm_; }
  double highest_mm() const { return highest_mm_; }
  double width_mm() const { return width_mm_; }
  double height_mm() const { return height_mm_; }

 private:
  explicit Relief(EmbreeScene scene) : scene_(std::move(scene)) {}
  EmbreeScene scene_;
  double start_mm_ = 0;  // above everything
  double width_mm_ = 0, height_mm_ = 0;
  double lowest_mm_ = 0, highest_mm_ = 0;  // within the part
};

}  // namespace mesorig::renderer
