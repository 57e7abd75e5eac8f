#pragma once
// A scene's object on the graphics card.

#include "renderer/gl/gl_objects.h"
#include "renderer/scene/mesh.h"
#include "renderer/scene/view_transform.h"

namespace mesorig::renderer {

// Lives on the context's thread. Vertex attributes 0 to 3 are those of Vertex, 4 and 5 those of
// Stretch where the material needs it (shaders/mesh.vert).
struct GlMesh {
  GlVertexArray array;
  GlBuffer vertices, stretches, indices;
  GLsizei index_count = 0;
  Matrix4 world_from_object{};
  TextureScale units_per_mm;
  Material material = Material::kBtf;

  void Draw() const;  // with the program in use
};

// `scale` is ScaleTexture's of this object.
GlMesh UploadObject(const Object& object, TextureScale scale);

void SetVector(GLuint program, GLint location, Vec3 value);
void SetMatrix(GLuint program, GLint location, const Matrix4& value);

}  // namespace mesorig::renderer
