#include "isobrick/viewer/egl_context.h"

#include <dlfcn.h>
#include <epoxy/gl.h>

#include <cstdlib>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/render/gl_debug_output.h"

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

EGLContext makeContext(EGLDisplay display, EGLConfig config, EGLint major, EGLint minor) {
  // Words of EGL 1.5, and of EGL_KHR_create_context, which has the same numbers.
  const EGLint debugging = driversAreHeard() ? EGL_CONTEXT_OPENGL_DEBUG_BIT_KHR : 0;
  const EGLint wishes[] = {EGL_CONTEXT_MAJOR_VERSION,
                           major,
                           EGL_CONTEXT_MINOR_VERSION,
                           minor,
                           EGL_CONTEXT_OPENGL_PROFILE_MASK,
                           EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                           EGL_CONTEXT_FLAGS_KHR,
                           debugging,
                           EGL_NONE};
  return eglCreateContext(display, config, EGL_NO_CONTEXT, wishes);
}

// "softpipe has 3.3 (Core Profile) Mesa 22.3.6"; empty if the driver has no core profile at all.
std::string versionOf(EGLDisplay display, EGLConfig config, EGLSurface surface) {
  const EGLContext context = makeContext(display, config, 3, 2);
  if (context == EGL_NO_CONTEXT) return {};
  std::string words;
  if (eglMakeCurrent(display, surface, surface, context)) {
    const auto say = [](GLenum name) -> std::string {
      const GLubyte* const text = glGetString(name);
      return text == nullptr ? "nothing" : reinterpret_cast<const char*>(text);
    };
    words = say(GL_RENDERER) + " has " + say(GL_VERSION);
    eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  }
  eglDestroyContext(display, context);
  return words;
}

}  // namespace

EglContext::EglContext() {
  requireLibraries();
  const char* const wish = std::getenv("ISOBRICK_GRAPHICS");
  std::string instead;
  for (const EglPlace& place : chosenPlaces(eglPlaces(), wish == nullptr ? "" : wish)) {
    if (!openOn(displayOf(place), instead)) continue;
    place_name_ = place.name;
    return;
  }
  if (!instead.empty())
    throw Error(
        "cannot render: OpenGL 4.5 is needed, and " + instead +
        "; update the graphics driver or Mesa, or choose another device (ISOBRICK_GRAPHICS, "
        "see 'isobrick info')");
  throw Error(std::string("cannot render: EGL gives no OpenGL 4.5 context without a window; ") +
              kInstallAdvice);
}

// A display belongs to the whole process and is never terminated: that would pull it from under
// other contexts.
EglContext::~EglContext() {
  eglDestroyContext(display_, context_);
  eglDestroySurface(display_, surface_);
}

bool EglContext::openOn(EGLDisplay display, std::string& instead) {
  if (display == EGL_NO_DISPLAY || !eglInitialize(display, nullptr, nullptr)) return false;
  if (!eglBindAPI(EGL_OPENGL_API)) return false;
  const EGLint config_wishes[] = {EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE,
                                  EGL_OPENGL_BIT, EGL_NONE};
  EGLConfig config = nullptr;
  EGLint configs = 0;
  if (!eglChooseConfig(display, config_wishes, &config, 1, &configs) || configs < 1) return false;
  // Never drawn to; some drivers make no context current without a surface.
  const EGLint surface_wishes[] = {EGL_WIDTH, 1, EGL_HEIGHT, 1, EGL_NONE};
  const EGLSurface surface = eglCreatePbufferSurface(display, config, surface_wishes);
  if (surface == EGL_NO_SURFACE) return false;
  const EGLContext context = makeContext(display, config, 4, 5);
  if (context != EGL_NO_CONTEXT) {
    display_ = display;
    surface_ = surface;
    context_ = context;
    return true;
  }
  if (instead.empty()) instead = versionOf(display, config, surface);
  eglDestroySurface(display, surface);
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
