// The panel over the picture: what is shown, as things to drag and to type in. Knows Dear ImGui,
// with its source.
#pragma once

#include <deque>
#include <string>

#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/window/open_panel.h"

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

// One at a time, on the thread of the current context, while that context lives. For each frame:
// feed() its events, begin(), build(), draw().
class ViewPanel {
 public:
  // Throws Error where ImGui cannot use the context.
  explicit ViewPanel(double scale);
  ~ViewPanel();
  ViewPanel(const ViewPanel&) = delete;
  ViewPanel& operator=(const ViewPanel&) = delete;

  void feed(const InputEvent& event);
  void begin(int width, int height, double seconds);
  // Whether events of the mouse, and of the keyboard, are the panel's in this frame.
  bool wantsMouse() const;
  bool wantsKeyboard() const;
  // Changes the session's state as hands have it; null: nothing is open.
  Wishes build(ViewSession* session, const PanelFacts& facts);
  // The list of volumes to open, on and off.
  void toggleOpening() { open_panel_.visible = !open_panel_.visible; }
  // Into the framebuffer that is bound.
  void draw();
  // In place of draw(), where there is no picture.
  void discard();

 private:
  void histogram(ViewSession& session);
  void surfaces(ViewSession& session);
  void focus(ViewSession& session);
  void detail(ViewSession& session);
  void tolerance(double& value, double sigma, double span);
  void clipPlanes(ViewSession& session);
  void slices(ViewSession& session);
  void look(ViewSession& session);
  Wishes all(ViewSession& session, const PanelFacts& facts);
  Wishes files(ViewPictures& pictures);
  void statistics(const ViewSession& session, const PanelFacts& facts);
  Wishes statusLine(ViewSession* session, const PanelFacts& facts);
  Wishes openingLine(const PanelFacts& facts);
  Wishes openingError(const PanelFacts& facts);
  void sessionLine(ViewSession& session, const PanelFacts& facts);
  void scaleBar(const ViewSession& session);
  void axisCube(const ViewSession& session);
  void handles(const ViewSession& session);
  void help(ViewSession& session);

  double scale_;
  std::string hover_;  // the position under the cursor
  OpenPanel open_panel_;
};

}  // namespace isobrick
