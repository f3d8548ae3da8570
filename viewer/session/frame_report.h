// The times of a script's frames, as JSON.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/viewer/session/surface_wait.h"
#include "isobrick/viewer/session/view_session.h"

namespace isobrick {

// How long one frame took, in seconds.
struct FrameTimes {
  double interface = 0.0;  // events, state, panel, requests and uploads
  double draw = 0.0;       // the scene and the panel, by the graphics card or the processor
};

// The figures of a frame in a script's report.
struct ReportedFrame {
  double seconds = 0.0;  // since the begin
  FrameTimes times;
  bool scene_drawn = true;  // and not only shown again, as nothing in it changed
  double surface_age = 0.0;
  double shown_radius = 0.0;
  std::uint64_t triangles = 0;
  std::uint64_t triangles_made = 0;
  std::uint64_t uploaded_bytes = 0;
  std::vector<SurfaceWait> waits;
};

// docs/reference/viewer-scripts.md has the fields. `device`: that drew; `status`: after the last
// frame.
std::string reportOf(const std::vector<ReportedFrame>& frames, const std::string& device,
                     const SessionStatus& status);

}  // namespace isobrick
