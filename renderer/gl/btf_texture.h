#pragma once
// A BTF's factors as an array texture with mip levels and a table, and the GLSL that decodes them.
// Filtering layers is valid because every decoder here is linear in them at fixed directions.

#include "renderer/gl/btf_source.h"
#include "renderer/gl/context.h"
#include "renderer/gl/direction_tables.h"
#include "renderer/gl/gl_objects.h"

namespace mesorig::renderer {

// A texture of `layers` images of width x height linear RGB, repeating, mip-mapped, as half floats
// of values / scale.
struct LayeredTexture {
  GlTexture texture;
  float scale = 1;  // a power of two
};
// `rgb` holds W*H*3 values a layer. InvalidArgument when the size exceeds `limits`.
StatusOr<LayeredTexture> MakeLayeredTexture(GLenum target, int width, int height, int layers,
                                            const std::vector<float>& rgb, const GlLimits& limits);

// Lives on the context's thread; keeps nothing of the source.
class BtfTexture {
 public:
  // InvalidArgument when the BTF does not fit an array texture of this driver; Unavailable when
  // there is no memory for it.
  static StatusOr<BtfTexture> Create(const BtfSource& source, const GlLimits& limits);
  // Interpolate, HorizonScale, PairsAround and DecodeBtf (shaders/, codecs/shader_form.h).
  const std::vector<std::string>& glsl() const { return glsl_; }
  // Binds texture units 0 and 2 to 6, and sets the decoder's uniforms of `program`.
  void Bind(GLuint program) const;
  size_t bytes() const { return bytes_; }  // of the finest level

 private:
  LayeredTexture layers_;
  BufferTexture table_, direction_rows_, direction_map_;
  BufferTexture light_directions_, substitutes_;  // empty where every pair is present
  int columns_ = 0;                               // stride of the table
  std::vector<std::string> glsl_;
  size_t bytes_ = 0;
};

}  // namespace mesorig::renderer
