#include "renderer/gl/render_targets.h"

#include <algorithm>

#include "renderer/gl/context.h"

namespace mesorig::renderer {
namespace {

GlRenderbuffer MakeRenderbuffer(GLenum format, int width, int height, int samples) {
  GLuint name = 0;
  glCreateRenderbuffers(1, &name);
  glNamedRenderbufferStorageMultisample(name, samples > 1 ? samples : 0, format, width, height);
  return GlRenderbuffer(name);
}

GlFramebuffer MakeFramebuffer() {
  GLuint name = 0;
  glCreateFramebuffers(1, &name);
  return GlFramebuffer(name);
}

Status CheckFramebuffer(const GlFramebuffer& framebuffer, int width, int height) {
  MESORIG_RETURN_IF_ERROR(CheckGl(fmt::format("a target of {} x {} pixels", width, height)));
  const GLenum status = glCheckNamedFramebufferStatus(framebuffer.name(), GL_FRAMEBUFFER);
  if (status == GL_FRAMEBUFFER_COMPLETE) return OkStatus();
  return Unavailable("OpenGL: the driver refuses a target of {} x {} pixels ({:#x})", width, height,
                     status);
}

// Rows from the bottom, as OpenGL reads them, to rows from the top.
template <typename T>
void FlipRows(std::vector<T>& values, int height) {
  const size_t row = values.size() / static_cast<size_t>(height);
  for (int top = 0, bottom = height - 1; top < bottom; ++top, --bottom) {
    std::swap_ranges(values.begin() + static_cast<std::ptrdiff_t>(row) * top,
                     values.begin() + static_cast<std::ptrdiff_t>(row) * (top + 1),
                     values.begin() + static_cast<std::ptrdiff_t>(row) * bottom);
  }
}

}  // namespace

StatusOr<LinearTarget> LinearTarget::Create(int width, int height, int samples) {
  LinearTarget target;
  target.width_ = width;
  target.height_ = height;
  target.multisampled_ = samples > 1;
  GLuint texture = 0;
  glCreateTextures(GL_TEXTURE_2D, 1, &texture);
  target.resolved_ = GlTexture(texture);
  glTextureStorage2D(texture, 1, GL_RGBA16F, width, height);
  target.resolve_ = MakeFramebuffer();
  glNamedFramebufferTexture(target.resolve_.name(), GL_COLOR_ATTACHMENT0, texture, 0);
  target.depth_ = MakeRenderbuffer(GL_DEPTH_COMPONENT32F, width, height, samples);
  if (target.multisampled_) {
    target.colour_ = MakeRenderbuffer(GL_RGBA16F, width, height, samples);
    target.draw_ = MakeFramebuffer();
    glNamedFramebufferRenderbuffer(target.draw_.name(), GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER,
                                   target.colour_.name());
  }
  const GlFramebuffer& draw = target.multisampled_ ? target.draw_ : target.resolve_;
  glNamedFramebufferRenderbuffer(draw.name(), GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER,
                                 target.depth_.name());
  MESORIG_RETURN_IF_ERROR(CheckFramebuffer(draw, width, height));
  return target;
}

void LinearTarget::Resume() const {
  glBindFramebuffer(GL_FRAMEBUFFER, multisampled_ ? draw_.name() : resolve_.name());
  glViewport(0, 0, width_, height_);
}

void LinearTarget::Bind() const {
  Resume();
  glClear(GL_DEPTH_BUFFER_BIT);
}

GLuint LinearTarget::Resolve() const {
  if (multisampled_) {
    glBlitNamedFramebuffer(draw_.name(), resolve_.name(), 0, 0, width_, height_, 0, 0, width_,
                           height_, GL_COLOR_BUFFER_BIT, GL_NEAREST);
  }
  return resolved_.name();
}

StatusOr<PictureTarget> PictureTarget::Create(int width, int height) {
  PictureTarget target;
  target.width_ = width;
  target.height_ = height;
  target.colour_ = MakeRenderbuffer(GL_RGBA8, width, height, 1);
  target.framebuffer_ = MakeFramebuffer();
  glNamedFramebufferRenderbuffer(target.framebuffer_.name(), GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER,
                                 target.colour_.name());
  MESORIG_RETURN_IF_ERROR(CheckFramebuffer(target.framebuffer_, width, height));
  return target;
}

void PictureTarget::Bind() const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  glViewport(0, 0, width_, height_);
}

Picture PictureTarget::Read() const {
  Picture picture{width_, height_, {}};
  picture.rgb.resize(static_cast<size_t>(width_) * static_cast<size_t>(height_) * 3);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer_.name());
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, width_, height_, GL_RGB, GL_UNSIGNED_BYTE, picture.rgb.data());
  FlipRows(picture.rgb, height_);
  return picture;
}

StatusOr<ProbeTarget> ProbeTarget::Create(int width, int height, int count) {
  ProbeTarget target;
  target.width_ = width;
  target.height_ = height;
  target.framebuffer_ = MakeFramebuffer();
  const GLuint framebuffer = target.framebuffer_.name();
  std::vector<GLenum> attachments;
  for (int i = 0; i < count; ++i) {
    const GLenum attachment = GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(i);
    target.colours_.push_back(MakeRenderbuffer(GL_RGBA32F, width, height, 1));
    glNamedFramebufferRenderbuffer(framebuffer, attachment, GL_RENDERBUFFER,
                                   target.colours_.back().name());
    attachments.push_back(attachment);
  }
  glNamedFramebufferDrawBuffers(framebuffer, count, attachments.data());
  target.depth_ = MakeRenderbuffer(GL_DEPTH_COMPONENT32F, width, height, 1);
  glNamedFramebufferRenderbuffer(framebuffer, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER,
                                 target.depth_.name());
  MESORIG_RETURN_IF_ERROR(CheckFramebuffer(target.framebuffer_, width, height));
  return target;
}

void ProbeTarget::Resume() const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  glViewport(0, 0, width_, height_);
}

void ProbeTarget::Bind() const {
  Resume();
  glClearColor(0, 0, 0, 0);
  glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
}

std::vector<float> ProbeTarget::Read(int index) const {
  std::vector<float> values(static_cast<size_t>(width_) * static_cast<size_t>(height_) * 4);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer_.name());
  glReadBuffer(GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(index));
  glReadPixels(0, 0, width_, height_, GL_RGBA, GL_FLOAT, values.data());
  FlipRows(values, height_);
  return values;
}

}  // namespace mesorig::renderer
