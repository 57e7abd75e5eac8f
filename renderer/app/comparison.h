#pragma once
// How near the silhouettes drawn with an MDF come to those of the truly displaced surface.

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "renderer/gl/scene_renderer.h"
#include "renderer/tracer/tracer.h"

namespace mesorig::renderer {

struct ComparisonInput {
  const Scene& scene;  // as it is drawn
  const BtfSource& source;
  const btf::Mdf& mdf;
  const GlContext& context;
  std::filesystem::path relief;   // an OBJ (renderer/tracer/relief.h)
  std::filesystem::path picture;  // where to put the pictures side by side; empty: nowhere
};

// Figures: silhouette_iou and silhouette_iou_btf_only against the traced mask of the displaced
// surface, over the pixels between the silhouettes of the surface and of the surface moved inwards
// by the relief's largest depth; only objects with an MDF count, one sample at each pixel's centre.
// band_pixels, relief_depth_mm, traced_triangles, and the milliseconds of each part.
// The picture: BTF alone, with the MDF, traced (diffuse, with shadows); below them the part where
// the silhouettes of the first and the last differ most, enlarged.
// InvalidArgument when no object has an MDF or the relief does not suit; FailedPrecondition when
// the band is empty.
StatusOr<nlohmann::json> CompareSilhouettes(const ComparisonInput& input);

}  // namespace mesorig::renderer
