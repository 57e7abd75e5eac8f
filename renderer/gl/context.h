#pragma once
// A headless OpenGL 4.5 core context: EGL on the surfaceless platform, no display, no window.

#include <string>

#include "protocol/base/status.h"

namespace mesorig::renderer {

struct GlLimits {
  int array_layers = 0;  // of an array texture
  int texture_size = 0;  // pixels
  int samples = 0;       // a pixel, of a colour target
};

// Current on the thread that created it, and used only there. All GL objects must be gone before
// it goes.
class GlContext {
 public:
  // Unavailable with the reason: no EGL library, no driver, no OpenGL 4.5.
  static StatusOr<GlContext> Create();
  GlContext(GlContext&& other) noexcept;
  GlContext& operator=(GlContext&&) = delete;
  ~GlContext();
  const std::string& renderer_name() const { return renderer_name_; }  // "llvmpipe (...)"
  const std::string& version() const { return version_; }
  const GlLimits& limits() const { return limits_; }

 private:
  GlContext(void* display, void* context) : display_(display), context_(context) {}
  void* display_;  // EGLDisplay
  void* context_;  // EGLContext
  std::string renderer_name_, version_;
  GlLimits limits_;
};

// Internal (or Unavailable when out of memory), naming `operation`, if OpenGL has an error pending.
Status CheckGl(std::string_view operation);

}  // namespace mesorig::renderer
