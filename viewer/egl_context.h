// An OpenGL context without a window or an X server, on one of the displays of a machine, which are
// tried in an order. Needs OpenGL's headers: for the renderer's own files alone.
#pragma once

#include <epoxy/egl.h>

#include <string>
#include <vector>

namespace isobrick {

struct EglPlace {
  // "device:0", "device:1", ..., "surfaceless", "display": as ISOBRICK_GRAPHICS names it.
  std::string name;
  std::string about;         // the driver's words; may be empty
  bool is_software = false;  // certainly: the processor draws
  EGLDeviceEXT device = EGL_NO_DEVICE_EXT;

  bool operator==(const EglPlace&) const = default;
};

// Cards (EGL_EXT_platform_device), then Mesa's platform without a window system, then the default
// display, then devices in software: a server with a card uses it, whatever display it has.
std::vector<EglPlace> inOrderOfTrial(std::vector<EglPlace> devices, bool has_surfaceless);

// Those that ISOBRICK_GRAPHICS names: a place, or "software" for all that are. All, if `wish` is
// empty. Throws Error, which lists the names, if there is none.
std::vector<EglPlace> chosenPlaces(const std::vector<EglPlace>& places, const std::string& wish);

// Of this machine. The libraries of EGL are there.
std::vector<EglPlace> eglPlaces();
// The display of a place; EGL_NO_DISPLAY if the driver has none for it.
EGLDisplay displayOf(const EglPlace& place);

// Owns an OpenGL 4.5 core context and the tiny surface that some drivers need beside it. GL objects
// made in the context die with it.
//
// Threads: current on one thread at a time, by a CurrentScope; different contexts are independent.
class EglContext {
 public:
  // On the first place of eglPlaces() that has OpenGL 4.5, or of those that the environment's
  // ISOBRICK_GRAPHICS names. Throws Error if there is none: what to install, or what the driver has
  // instead.
  EglContext();
  // The context must not be current on another thread.
  ~EglContext();
  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;

  const std::string& placeName() const { return place_name_; }

  // Makes the context current on this thread, and none at the end, so that the next call may come
  // from another thread. The context outlives it. GL functions may be called only inside of one.
  class CurrentScope {
   public:
    // Throws Error if the context is current on another thread.
    explicit CurrentScope(const EglContext& context);
    ~CurrentScope();
    CurrentScope(const CurrentScope&) = delete;
    CurrentScope& operator=(const CurrentScope&) = delete;

   private:
    EGLDisplay display_;
  };

 private:
  // False, with nothing made, if the display has no OpenGL 4.5; `instead` then gets the words of a
  // driver that has an earlier one.
  bool openOn(EGLDisplay display, std::string& instead);

  EGLDisplay display_ = EGL_NO_DISPLAY;
  EGLSurface surface_ = EGL_NO_SURFACE;
  EGLContext context_ = EGL_NO_CONTEXT;
  std::string place_name_;
};

}  // namespace isobrick
