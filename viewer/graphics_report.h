// What draws on this machine, for people who wonder.
#pragma once

#include <string>
#include <vector>

#include "isobrick/viewer/render/gl_device.h"

namespace isobrick {

struct GraphicsReport {
  std::string device;        // "llvmpipe (LLVM 15.0.6, 256 bits)"
  std::string vendor;        // of the driver
  std::string version;       // of OpenGL and of the driver
  bool is_software = false;  // the processor draws
  std::string place;         // that it was found at: one of `places`

  struct Place {
    std::string name;   // as ISOBRICK_GRAPHICS takes it
    std::string about;  // the driver's words; may be empty
  };
  std::vector<Place> places;  // in the order in which they are tried

  std::vector<GlLimits::Row> limits;
  std::vector<std::string> switched_off;  // for the limits of this card; a line each
};

// Of pictures without a window. A window has the device of its display. Throws Error if nothing
// draws here.
GraphicsReport graphicsReport();

}  // namespace isobrick
