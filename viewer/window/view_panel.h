// The interface over the picture, and the context of Dear ImGui that it is drawn with.
#pragma once

#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/window/open_panel.h"
#include "isobrick/viewer/window/status_panel.h"

namespace isobrick {

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
  // Changes the session's state as the user asks; null: nothing is open.
  Wishes build(ViewSession* session, const PanelFacts& facts);
  // The list of volumes to open, on and off.
  void toggleOpening() { open_panel_.visible = !open_panel_.visible; }
  // Into the framebuffer that is bound.
  void draw();
  // In place of draw(), where there is no picture.
  void discard();

 private:
  Wishes panel(ViewSession& session, const PanelFacts& facts);

  double scale_;
  StatusPanel status_;
  OpenPanel open_panel_;
};

}  // namespace isobrick
