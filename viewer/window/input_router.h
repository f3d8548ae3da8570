// The way of events: from the target to the panel and the session, frame by frame.
#pragma once

#include <deque>
#include <glm/vec2.hpp>
#include <vector>

#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/window/view_panel.h"
#include "isobrick/viewer/window/view_target.h"

namespace isobrick {

// Keeps the events that no frame has taken yet, and the size of the window and the cursor in it,
// which they report.
class InputRouter {
 public:
  // `target` outlives it.
  explicit InputRouter(ViewTarget& target);

  // Waits for events of the target for at most so long; true if some came. They get the times
  // between which they came: events that nobody looked for in a slow frame are reported at its end.
  bool take(double wait_seconds);
  void add(const std::vector<InputEvent>& events) {
    events_.insert(events_.end(), events.begin(), events.end());
  }
  bool empty() const { return events_.empty(); }

  // A frame's events go to the panel and to the session (null: none is there), at most one of a
  // button or of the same key, so that none is lost in a frame, and none while a click waits for
  // its place. The panel's frame is begun.
  Wishes pass(ViewPanel& panel, ViewSession* session, double seconds);

  int width() const { return width_; }
  int height() const { return height_; }
  glm::dvec2 size() const { return {width_, height_}; }
  WindowAreas areas(const ViewSession* session) const;

  // The view while nothing is open.
  ViewState& idleState() { return idle_state_; }

 private:
  std::vector<InputEvent> eventsOfFrame();
  void feed(const InputEvent& event, ViewPanel& panel);
  InputEvent inScene(InputEvent event, const ViewSession* session) const;
  void layOut(ViewSession& session);

  ViewTarget& target_;
  std::deque<InputEvent> events_;
  int width_ = 0, height_ = 0;
  int left_ = 0;            // of the scene's area in the window
  glm::dvec2 cursor_{0.0};  // in the window
  double looked_ = 0.0;     // for events
  double last_frame_;
  Interaction idle_interaction_;
  ViewState idle_state_;
};

}  // namespace isobrick
