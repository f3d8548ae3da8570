// An OpenGL context without a window or an X server. Needs OpenGL's headers: for the renderer's
// own files alone.
#pragma once

#include <epoxy/egl.h>

namespace isobrick {

// Owns an OpenGL 4.5 core context and the tiny surface that some drivers need beside it. GL objects
// made in the context die with it.
//
// Threads: current on one thread at a time, by a CurrentScope; different contexts are independent.
class EglContext {
 public:
  // Prefers Mesa's surfaceless platform and falls back to the default display. Throws Error that
  // says what to install if no context can be made.
  EglContext();
  // The context must not be current on another thread.
  ~EglContext();
  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;

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
  // False, with nothing made, if the display is of no use.
  bool openOn(EGLDisplay display);

  EGLDisplay display_ = EGL_NO_DISPLAY;
  EGLSurface surface_ = EGL_NO_SURFACE;
  EGLContext context_ = EGL_NO_CONTEXT;
};

}  // namespace isobrick
