#pragma once
// OpenGL objects that are deleted with their owner. Used on the context's thread only.

#include <epoxy/gl.h>

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::renderer {

// Owns one GL name; `Delete` is a stateless function object.
template <typename Delete>
class GlHandle {
 public:
  GlHandle() = default;
  explicit GlHandle(GLuint name) : name_(name) {}
  GlHandle(GlHandle&& other) noexcept : name_(std::exchange(other.name_, 0)) {}
  GlHandle& operator=(GlHandle&& other) noexcept {
    std::swap(name_, other.name_);
    return *this;
  }
  ~GlHandle() {
    if (name_ != 0) Delete()(name_);
  }
  GLuint name() const { return name_; }

 private:
  GLuint name_ = 0;
};

struct DeleteBuffer {
  void operator()(GLuint name) const { glDeleteBuffers(1, &name); }
};
struct DeleteTexture {
  void operator()(GLuint name) const { glDeleteTextures(1, &name); }
};
struct DeleteRenderbuffer {
  void operator()(GLuint name) const { glDeleteRenderbuffers(1, &name); }
};
struct DeleteFramebuffer {
  void operator()(GLuint name) const { glDeleteFramebuffers(1, &name); }
};
struct DeleteVertexArray {
  void operator()(GLuint name) const { glDeleteVertexArrays(1, &name); }
};
struct DeleteProgram {
  void operator()(GLuint name) const { glDeleteProgram(name); }
};
using GlBuffer = GlHandle<DeleteBuffer>;
using GlTexture = GlHandle<DeleteTexture>;
using GlRenderbuffer = GlHandle<DeleteRenderbuffer>;
using GlFramebuffer = GlHandle<DeleteFramebuffer>;
using GlVertexArray = GlHandle<DeleteVertexArray>;
using GlProgram = GlHandle<DeleteProgram>;

// An immutable buffer with the bytes of `data`; an empty one gets 16 zero bytes, so that it can be
// bound.
template <typename T>
GlBuffer MakeBuffer(const std::vector<T>& data) {
  static constexpr char kNothing[16] = {};
  GLuint name = 0;
  glCreateBuffers(1, &name);
  const bool empty = data.empty();
  glNamedBufferStorage(
      name, empty ? 16 : static_cast<GLsizeiptr>(data.size() * sizeof(T)),
      empty ? static_cast<const void*>(kNothing) : static_cast<const void*>(data.data()), 0);
  return GlBuffer(name);
}

// A buffer that shaders read as a samplerBuffer.
struct BufferTexture {
  GlBuffer buffer;
  GlTexture texture;
};
template <typename T>
BufferTexture MakeBufferTexture(GLenum format, const std::vector<T>& data) {
  BufferTexture result;
  result.buffer = MakeBuffer(data);
  GLuint name = 0;
  glCreateTextures(GL_TEXTURE_BUFFER, 1, &name);
  result.texture = GlTexture(name);
  glTextureBuffer(name, format, result.buffer.name());
  return result;
}

// A stage is the concatenation of its pieces, the first of which starts with #version. Internal
// with the compiler's log: our shaders and the codecs' are our own code.
struct ShaderStage {
  GLenum type;  // GL_VERTEX_SHADER ...
  std::vector<std::string> pieces;
};
StatusOr<GlProgram> BuildProgram(std::string_view name, const std::vector<ShaderStage>& stages);

}  // namespace mesorig::renderer
