#include "renderer/gl/gl_mesh.h"

#include <cstddef>

namespace mesorig::renderer {
namespace {

struct Attribute {
  GLint size;
  size_t offset;
};

// Attributes from `first` on, of the buffer at `binding`.
void SetAttributes(GLuint array, GLuint binding, GLuint first,
                   const std::vector<Attribute>& attributes) {
  for (const Attribute& attribute : attributes) {
    glEnableVertexArrayAttrib(array, first);
    glVertexArrayAttribFormat(array, first, attribute.size, GL_FLOAT, GL_FALSE,
                              static_cast<GLuint>(attribute.offset));
    glVertexArrayAttribBinding(array, first, binding);
    ++first;
  }
}

}  // namespace

GlMesh UploadObject(const Object& object, TextureScale scale) {
  const Mesh mesh = MakeMesh(object);
  GlMesh result;
  result.material = object.material;
  result.units_per_mm = scale;
  result.world_from_object = FromRigid(Placement(object));
  result.vertices = MakeBuffer(mesh.vertices);
  result.indices = MakeBuffer(mesh.indices);
  result.index_count = static_cast<GLsizei>(mesh.indices.size());
  GLuint name = 0;
  glCreateVertexArrays(1, &name);
  result.array = GlVertexArray(name);
  glVertexArrayElementBuffer(name, result.indices.name());
  glVertexArrayVertexBuffer(name, 0, result.vertices.name(), 0, sizeof(Vertex));
  SetAttributes(name, 0, 0,
                {{3, offsetof(Vertex, position)},
                 {3, offsetof(Vertex, normal)},
                 {3, offsetof(Vertex, tangent)},
                 {2, offsetof(Vertex, texture_mm)}});
  if (object.material == Material::kBtfMdf) {
    result.stretches = MakeBuffer(StretchOf(mesh));
    glVertexArrayVertexBuffer(name, 1, result.stretches.name(), 0, sizeof(Stretch));
    SetAttributes(name, 1, 4, {{3, offsetof(Stretch, along_x)}, {3, offsetof(Stretch, along_y)}});
  }
  return result;
}

void GlMesh::Draw() const {
  glBindVertexArray(array.name());
  glDrawElements(GL_TRIANGLES, index_count, GL_UNSIGNED_INT, nullptr);
}

void SetVector(GLuint program, GLint location, Vec3 value) {
  glProgramUniform3f(program, location, static_cast<float>(value.x), static_cast<float>(value.y),
                     static_cast<float>(value.z));
}

void SetMatrix(GLuint program, GLint location, const Matrix4& value) {
  std::array<float, 16> floats;
  for (size_t i = 0; i < 16; ++i) floats[i] = static_cast<float>(value[i]);
  glProgramUniformMatrix4fv(program, location, 1, GL_FALSE, floats.data());
}

}  // namespace mesorig::renderer
