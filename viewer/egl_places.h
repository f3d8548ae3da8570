// The displays of a machine that may draw without a window, in the order in which they are tried.
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

}  // namespace isobrick
