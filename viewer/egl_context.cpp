#include "isobrick/viewer/egl_context.h"

#include <dlfcn.h>
#include <epoxy/gl.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdlib>
#include <string>
#include <string_view>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/render/gl_debug_output.h"

namespace isobrick {
namespace {

constexpr char kSurfaceless[] = "surfaceless";
constexpr char kDisplay[] = "display";

bool hasClientExtension(const char* name) { return epoxy_has_egl_extension(EGL_NO_DISPLAY, name); }

// A list of words; no word is the beginning of another one that is asked for here.
bool deviceHas(EGLDeviceEXT device, std::string_view extension) {
  const char* const all = eglQueryDeviceStringEXT(device, EGL_EXTENSIONS);
  return all != nullptr && std::string_view(all).find(extension) != std::string_view::npos;
}

std::string aboutDevice(EGLDeviceEXT device) {
  const auto say = [&](const char* extension, EGLint name) -> std::string {
    if (!deviceHas(device, extension)) return {};
    const char* const text = eglQueryDeviceStringEXT(device, name);
    return text == nullptr ? "" : text;
  };
  constexpr EGLint kRenderer = 0x335F;  // EGL_RENDERER_EXT
  const std::string renderer = say("EGL_EXT_device_query_name", kRenderer);
  if (!renderer.empty()) return renderer;
  // Mesa 22 lists EGL_EXT_device_drm_render_node for its device in software, which has no file.
  if (deviceHas(device, "EGL_MESA_device_software")) return "software";
  return say("EGL_EXT_device_drm", EGL_DRM_DEVICE_FILE_EXT);
}

std::vector<EglPlace> devicesOfMachine() {
  std::vector<EglPlace> devices;
  if (!hasClientExtension("EGL_EXT_platform_base") ||
      !hasClientExtension("EGL_EXT_platform_device") ||
      !(hasClientExtension("EGL_EXT_device_enumeration") ||
        hasClientExtension("EGL_EXT_device_base")))
    return devices;
  std::array<EGLDeviceEXT, 64> found{};
  EGLint count = 0;
  if (!eglQueryDevicesEXT(static_cast<EGLint>(found.size()), found.data(), &count)) return devices;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i)
    devices.push_back({"device:" + std::to_string(i), aboutDevice(found[i]),
                       deviceHas(found[i], "EGL_MESA_device_software"), found[i]});
  return devices;
}

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

std::vector<EglPlace> inOrderOfTrial(std::vector<EglPlace> devices, bool has_surfaceless) {
  std::vector<EglPlace> places;
  const auto add = [&](bool software) {
    for (const EglPlace& device : devices)
      if (device.is_software == software) places.push_back(device);
  };
  add(false);
  if (has_surfaceless) places.push_back({kSurfaceless, "", false, EGL_NO_DEVICE_EXT});
  places.push_back({kDisplay, "", false, EGL_NO_DEVICE_EXT});
  add(true);
  return places;
}

std::vector<EglPlace> chosenPlaces(const std::vector<EglPlace>& places, const std::string& wish) {
  if (wish.empty()) return places;
  std::vector<EglPlace> chosen;
  for (const EglPlace& place : places)
    if (place.name == wish || (wish == "software" && place.is_software)) chosen.push_back(place);
  if (!chosen.empty()) return chosen;
  std::string names = "software";
  for (const EglPlace& place : places) names += ", " + place.name;
  throw Error("cannot render: ISOBRICK_GRAPHICS is '" + wish +
              "', which is nothing that draws here; choose one of " + names);
}

std::vector<EglPlace> eglPlaces() {
  return inOrderOfTrial(devicesOfMachine(),
                        hasClientExtension("EGL_EXT_platform_base") &&
                            hasClientExtension("EGL_MESA_platform_surfaceless"));
}

EGLDisplay displayOf(const EglPlace& place) {
  if (place.device != EGL_NO_DEVICE_EXT)
    return eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, place.device, nullptr);
  if (place.name == kSurfaceless)
    return eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
  return eglGetDisplay(EGL_DEFAULT_DISPLAY);
}

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
