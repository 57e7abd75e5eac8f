#pragma once
// Where a frame is drawn: a linear float target, antialiased or not, and what is read from it.

#include <vector>

#include "renderer/gl/gl_objects.h"
#include "renderer/scene/picture.h"

namespace mesorig::renderer {

// Linear RGBA half target of width x height, `samples` a pixel, with depth, and its resolved
// texture.
class LinearTarget {
 public:
  static StatusOr<LinearTarget> Create(int width, int height, int samples);
  void Bind() const;       // draw into it, depth cleared
  void Resume() const;     // draw on
  GLuint Resolve() const;  // the texture with one value a pixel

 private:
  int width_ = 0, height_ = 0;
  bool multisampled_ = false;
  GlRenderbuffer colour_, depth_;
  GlTexture resolved_;
  GlFramebuffer draw_, resolve_;
};

// RGBA8 target that is read back as a picture.
class PictureTarget {
 public:
  static StatusOr<PictureTarget> Create(int width, int height);
  void Bind() const;
  Picture Read() const;

 private:
  int width_ = 0, height_ = 0;
  GlRenderbuffer colour_;
  GlFramebuffer framebuffer_;
};

// `count` RGBA float targets of width x height, not antialiased, with depth.
class ProbeTarget {
 public:
  static StatusOr<ProbeTarget> Create(int width, int height, int count);
  void Bind() const;                         // cleared to zero
  void Resume() const;                       // draw on
  std::vector<float> Read(int index) const;  // RGBA, rows from the top

 private:
  int width_ = 0, height_ = 0;
  std::vector<GlRenderbuffer> colours_;
  GlRenderbuffer depth_;
  GlFramebuffer framebuffer_;
};

}  // namespace mesorig::renderer
