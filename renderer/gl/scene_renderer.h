#pragma once
// Draws a scene. Only what the scene uses is uploaded and compiled: no BTF for plain objects alone,
// no plain texture for BTF objects alone, no MDF and no peeling without an object that has one.

#include <array>
#include <memory>
#include <vector>

#include "processing/btf/mdf.h"
#include "renderer/gl/btf_source.h"
#include "renderer/gl/context.h"
#include "renderer/gl/silhouettes.h"
#include "renderer/scene/picture.h"
#include "renderer/scene/scene.h"

namespace mesorig::renderer {

// What the shader did at one pixel of the picture, read back as floats.
struct Fragment {
  int x = 0, y = 0;                 // pixel, from the top left
  int object = 0;                   // in Scene::objects
  double u = 0, v = 0;              // repeats of the sample from its top left corner, v downwards
  Vec3 view;                        // in the sample frame
  Vec3 normal, tangent;             // world: +z and +x of the sample frame
  std::array<float, 3> radiance{};  // exposure included
};

class SceneRenderer {
 public:
  // `source` and `mdf` may be gone afterwards; `context` must outlive the renderer, and all calls
  // are made on its thread. `mdf` may be null where no object of the scene has one. InvalidArgument
  // when the scene does not fit this BTF, this MDF or this driver; with an MDF, for msaa above 1
  // (whether the relief is hit is decided a shaded sample).
  static StatusOr<SceneRenderer> Create(const Scene& scene, const BtfSource& source,
                                        const GlContext& context, const btf::Mdf* mdf = nullptr);
  SceneRenderer(SceneRenderer&& other) noexcept;
  ~SceneRenderer();

  // Draws one frame; it is finished on return.
  void Draw();
  // The frame that was drawn last.
  StatusOr<Picture> ReadPicture() const;
  // Of the frame that was drawn last; 0 passes without an object that has an MDF.
  SilhouettePasses silhouette_passes() const;
  // The fragments of all objects, drawn once more: one sample at each pixel's centre, no mip
  // levels.
  StatusOr<std::vector<Fragment>> Probe() const;

 private:
  struct State;
  explicit SceneRenderer(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace mesorig::renderer
