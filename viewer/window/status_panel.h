// What is going on, for people: the line at the foot, what went wrong, and figures.
#pragma once

#include <deque>
#include <string>
#include <vector>

#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/volume_opener.h"

namespace isobrick {

// How long one frame took, in seconds.
struct FrameTimes {
  double interface = 0.0;  // events, state, panel, requests and uploads
  double draw = 0.0;       // the scene and the panel, by the graphics card or the processor
};

// What the panel shows beside the session.
struct PanelFacts {
  const std::deque<FrameTimes>& frames;  // the last ones
  std::string message;                   // what was done last: a file that was written
  std::string device;                    // what draws
  VolumeOpener::Status opening;
  std::string open_error;  // why the last opening ended without a volume; empty: it did not
  const std::vector<std::string>& recent;  // what was opened last
};

// Figures, into the window of Dear ImGui that is being built.
void buildStatistics(const ViewSession& session, const PanelFacts& facts, float scale);

// Builds the line at the foot and, above it, why the last opening ended without a volume.
class StatusPanel {
 public:
  // `session`: null: nothing is open. `hovers`: the cursor is over the scene.
  Wishes build(ViewSession* session, const PanelFacts& facts, float scale, bool hovers);

 private:
  void sessionLine(ViewSession& session, const PanelFacts& facts, float scale, bool hovers);

  std::string hover_;  // the position under the cursor
};

}  // namespace isobrick
