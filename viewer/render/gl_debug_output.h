// Messages of an OpenGL driver about the calls that it gets (KHR_debug).
#pragma once

#include <epoxy/gl.h>

#include <functional>
#include <string>

namespace isobrick {

struct DriverMessage {
  GLenum type = 0;      // GL_DEBUG_TYPE_ERROR, ...
  GLenum severity = 0;  // GL_DEBUG_SEVERITY_HIGH, ...
  std::string text;     // one line

  // Something is wrong: an error, undefined or deprecated behaviour, or of a high or medium
  // severity. All else is a hint.
  bool isComplaint() const;
  // "error, high: GL_INVALID_ENUM in glEnable(0x4)".
  std::string line() const;
};

// Called on the thread that draws, within the call that the message is about. Must not throw.
using DriverListener = std::function<void(const DriverMessage&)>;

// Hears the complaints of all contexts that are made from now on. Without a listener, or with an
// empty one, complaints go to stderr, a line each, if the environment sets ISOBRICK_GL_DEBUG to
// anything but nothing and 0; otherwise nobody hears them.
void listenToDrivers(DriverListener listener);

// Contexts are to be made for debugging: some drivers say little in others.
bool driversAreHeard();
// If so, the messages of the context that is current.
void hearCurrentDriver();

}  // namespace isobrick
