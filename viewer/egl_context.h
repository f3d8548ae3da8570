// An OpenGL context without a window or an X server. Needs OpenGL's headers: for the renderer's
// own files alone.
#pragma once

#include <epoxy/egl.h>

#include <string>

#include "isobrick/viewer/egl_places.h"

namespace isobrick {

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

  // The place that it was made on.
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
