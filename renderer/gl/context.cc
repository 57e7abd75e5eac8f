#include "renderer/gl/context.h"

#include <dlfcn.h>
#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include <utility>

namespace mesorig::renderer {
namespace {

constexpr std::string_view kRemedy = "(Debian packages: libegl-mesa0, libgl1-mesa-dri)";

// libepoxy ends the program when it cannot load a library, so look before it does.
Status CheckLibrary(const char* name) {
  void* library = dlopen(name, RTLD_LAZY | RTLD_LOCAL);
  if (library == nullptr) return Unavailable("OpenGL: {} cannot be loaded {}", name, kRemedy);
  dlclose(library);
  return OkStatus();
}

StatusOr<EGLDisplay> OpenDisplay() {
  MESORIG_RETURN_IF_ERROR(CheckLibrary("libEGL.so.1"));
  if (!epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_platform_base") ||
      !epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_MESA_platform_surfaceless")) {
    return Unavailable("OpenGL: this EGL has no surfaceless platform {}", kRemedy);
  }
  // (libepoxy aborts on eglGetPlatformDisplay: it wants EGL 1.5 of a display that is not there
  // yet.)
  EGLDisplay display =
      eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
  if (display == EGL_NO_DISPLAY || !eglInitialize(display, nullptr, nullptr)) {
    return Unavailable("OpenGL: EGL finds no driver (EGL error {:#x}) {}", eglGetError(), kRemedy);
  }
  return display;
}

StatusOr<EGLContext> OpenContext(EGLDisplay display) {
  if (!eglBindAPI(EGL_OPENGL_API)) return Unavailable("OpenGL: EGL offers no desktop OpenGL");
  const EGLint config_attributes[] = {EGL_SURFACE_TYPE, 0, EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT,
                                      EGL_NONE};
  EGLConfig config = nullptr;
  EGLint count = 0;
  if (!eglChooseConfig(display, config_attributes, &config, 1, &count) || count == 0) {
    return Unavailable("OpenGL: EGL has no configuration for desktop OpenGL");
  }
  const EGLint context_attributes[] = {EGL_CONTEXT_MAJOR_VERSION,
                                       4,
                                       EGL_CONTEXT_MINOR_VERSION,
                                       5,
                                       EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                       EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                       EGL_NONE};
  EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, context_attributes);
  if (context == EGL_NO_CONTEXT) {
    return Unavailable("OpenGL: the driver has no OpenGL 4.5 core (EGL error {:#x})",
                       eglGetError());
  }
  return context;
}

std::string GlString(GLenum name) {
  const auto* text = reinterpret_cast<const char*>(glGetString(name));
  return text == nullptr ? "" : text;
}

}  // namespace

StatusOr<GlContext> GlContext::Create() {
  MESORIG_ASSIGN_OR_RETURN(EGLDisplay display, OpenDisplay());
  auto context = OpenContext(display);
  if (!context.ok()) {
    eglTerminate(display);
    return context.status();
  }
  GlContext result(display, *context);
  if (!eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, *context)) {
    return Unavailable("OpenGL: the context cannot be used without a surface (EGL error {:#x})",
                       eglGetError());
  }
  result.renderer_name_ = GlString(GL_RENDERER);
  result.version_ = GlString(GL_VERSION);
  glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &result.limits_.array_layers);
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &result.limits_.texture_size);
  glGetIntegerv(GL_MAX_SAMPLES, &result.limits_.samples);
  return result;
}

GlContext::GlContext(GlContext&& other) noexcept
    : display_(std::exchange(other.display_, nullptr)),
      context_(std::exchange(other.context_, nullptr)),
      renderer_name_(std::move(other.renderer_name_)),
      version_(std::move(other.version_)),
      limits_(other.limits_) {}

GlContext::~GlContext() {
  if (display_ == nullptr) return;
  eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  eglDestroyContext(display_, context_);
  eglTerminate(display_);
}

Status CheckGl(std::string_view operation) {
  const GLenum error = glGetError();
  if (error == GL_NO_ERROR) return OkStatus();
  while (glGetError() != GL_NO_ERROR) {
  }
  if (error == GL_OUT_OF_MEMORY) return Unavailable("OpenGL: {}: out of memory", operation);
  return Internal("OpenGL: {}: error {:#x}", operation, error);
}

}  // namespace mesorig::renderer
