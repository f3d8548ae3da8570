#include "isobrick/viewer/egl_context.h"

#include <dlfcn.h>

#include <string>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

constexpr char kInstallAdvice[] =
    "install an OpenGL 4.5 driver (Debian and Ubuntu: apt install libegl1 libopengl0 "
    "libgl1-mesa-dri)";

// libepoxy ends the process if a library is missing; an Error is friendlier. The libraries stay
// loaded: libepoxy loads them next.
void requireLibraries() {
  const auto loads = [](const char* name) {
    return dlopen(name, RTLD_LAZY | RTLD_LOCAL) != nullptr;
  };
  if (!loads("libEGL.so.1") || !(loads("libOpenGL.so.0") || loads("libGL.so.1"))) {
    throw Error(std::string("cannot render: libEGL.so.1 or libOpenGL.so.0 is not here; ") +
                kInstallAdvice);
  }
}

}  // namespace

EglContext::EglContext() {
  requireLibraries();
  if (epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_platform_base") &&
      epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_MESA_platform_surfaceless")) {
    const EGLDisplay surfaceless =
        eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
    if (openOn(surfaceless)) return;
  }
  if (openOn(eglGetDisplay(EGL_DEFAULT_DISPLAY))) return;
  throw Error(std::string("cannot render: EGL gives no OpenGL 4.5 context without a window; ") +
              kInstallAdvice);
}

// A display belongs to the whole process and is never terminated: that would pull it from under
// other contexts.
EglContext::~EglContext() {
  eglDestroyContext(display_, context_);
  eglDestroySurface(display_, surface_);
}

bool EglContext::openOn(EGLDisplay display) {
  if (display == EGL_NO_DISPLAY || !eglInitialize(display, nullptr, nullptr)) return false;
  if (!eglBindAPI(EGL_OPENGL_API)) return false;
  const EGLint config_wishes[] = {EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE,
                                  EGL_OPENGL_BIT, EGL_NONE};
  EGLConfig config = nullptr;
  EGLint configs = 0;
  if (!eglChooseConfig(display, config_wishes, &config, 1, &configs) || configs < 1) return false;

  const EGLint context_wishes[] = {EGL_CONTEXT_MAJOR_VERSION,
                                   4,
                                   EGL_CONTEXT_MINOR_VERSION,
                                   5,
                                   EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                   EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                   EGL_NONE};
  // Never drawn to; some drivers make no context current without a surface.
  const EGLint surface_wishes[] = {EGL_WIDTH, 1, EGL_HEIGHT, 1, EGL_NONE};
  const EGLSurface surface = eglCreatePbufferSurface(display, config, surface_wishes);
  const EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, context_wishes);
  if (surface != EGL_NO_SURFACE && context != EGL_NO_CONTEXT) {
    display_ = display;
    surface_ = surface;
    context_ = context;
    return true;
  }
  if (surface != EGL_NO_SURFACE) eglDestroySurface(display, surface);
  if (context != EGL_NO_CONTEXT) eglDestroyContext(display, context);
  return false;
}

EglContext::CurrentScope::CurrentScope(const EglContext& context) : display_(context.display_) {
  eglBindAPI(EGL_OPENGL_API);  // EGL keeps the bound API per thread
  if (!eglMakeCurrent(display_, context.surface_, context.surface_, context.context_)) {
    throw Error(
        "cannot render: EGL could not make its context current; is the renderer in use on "
        "another thread?");
  }
}

EglContext::CurrentScope::~CurrentScope() {
  eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
}

}  // namespace isobrick
