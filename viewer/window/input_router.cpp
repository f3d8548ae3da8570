#include "isobrick/viewer/window/input_router.h"

#include <algorithm>
#include <utility>

#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {

InputRouter::InputRouter(ViewTarget& target) : target_(target), last_frame_(clockSeconds()) {}

bool InputRouter::take(double wait_seconds) {
  const double looked_last = std::exchange(looked_, clockSeconds());
  std::vector<InputEvent> events = target_.takeEvents(wait_seconds);
  const double now = clockSeconds();
  for (InputEvent& event : events) {
    event.seconds = now;
    event.waited = std::max(0.0, looked_ - looked_last);
  }
  looked_ = now;
  add(events);
  return !events.empty();
}

WindowAreas InputRouter::areas(const ViewSession* session) const {
  return windowAreas(width_, height_, target_.scale(),
                     session != nullptr && session->interaction().show_panel,
                     session != nullptr && session->state().slice_views.shown);
}

std::vector<InputEvent> InputRouter::eventsOfFrame() {
  std::vector<InputEvent> events;
  // ImGui takes a frame's text first and then one of the keys that edit it, so both wait for such a
  // key before them. Any key goes down once in a frame, with the same others held as the first.
  const auto edits = [](const InputEvent& press) { return press.control || press.key > Key::kZ; };
  const auto comesAfter = [&](const InputEvent& press, const InputEvent& next) {
    if (press.kind != InputEvent::Kind::kKeyPress) return false;
    if (next.kind == InputEvent::Kind::kText) return edits(press);
    return next.kind == InputEvent::Kind::kKeyPress &&
           (press.key == next.key || press.shift != next.shift || (edits(press) && edits(next)) ||
            press.control != next.control);
  };
  const auto waits = [&](const InputEvent& next) {
    return std::any_of(events.begin(), events.end(),
                       [&](const InputEvent& event) { return comesAfter(event, next); });
  };
  while (!events_.empty() && !waits(events_.front())) {
    events.push_back(events_.front());
    events_.pop_front();
    const InputEvent::Kind kind = events.back().kind;
    if (kind == InputEvent::Kind::kPress || kind == InputEvent::Kind::kRelease) break;
  }
  return events;
}

void InputRouter::feed(const InputEvent& event, ViewPanel& panel) {
  panel.feed(event);
  if (event.kind != InputEvent::Kind::kResize) return;
  width_ = static_cast<int>(event.x);
  height_ = static_cast<int>(event.y);
}

Wishes InputRouter::pass(ViewPanel& panel, ViewSession* session, double seconds) {
  std::vector<InputEvent> events;
  if (session == nullptr || !session->awaitsClick()) events = eventsOfFrame();
  for (const InputEvent& event : events) feed(event, panel);
  panel.begin(width_, height_, seconds - last_frame_);
  last_frame_ = seconds;
  Wishes wishes;
  for (const InputEvent& event : events) {
    const bool of_keyboard = event.kind == InputEvent::Kind::kKeyPress ||
                             event.kind == InputEvent::Kind::kKeyRelease ||
                             event.kind == InputEvent::Kind::kText;
    const bool on_panel = of_keyboard ? panel.wants(event) : panel.wantsMouse();
    if (event.kind == InputEvent::Kind::kMove) cursor_ = {event.x, event.y};
    addWishes(session != nullptr
                  ? session->apply(inScene(event, session), seconds, on_panel)
                  : applyEvent(event, seconds, on_panel, {}, idle_interaction_, idle_state_),
              wishes);
  }
  if (session != nullptr) layOut(*session);
  return wishes;
}

// An event of the window, in the scene's pixels.
InputEvent InputRouter::inScene(InputEvent event, const ViewSession* session) const {
  const SceneArea now = areas(session).scene;
  if (event.kind == InputEvent::Kind::kMove) event.x -= now.left;
  if (event.kind == InputEvent::Kind::kResize) {
    event.x = now.width;
    event.y = now.height;
  }
  return event;
}

// Gives the session the size of its area, and the cursor in it.
void InputRouter::layOut(ViewSession& session) {
  session.interaction().scale = target_.scale();
  const SceneArea now = areas(&session).scene;
  const Interaction& interaction = session.interaction();
  if (interaction.size != glm::dvec2(now.width, now.height))
    session.apply(InputEvent::resized(now.width, now.height), last_frame_, false);
  // The panel came or went under the cursor, which has not moved.
  const double shift = std::exchange(left_, now.left) - now.left;
  session.interaction().pressed_at.x += shift;
  if (interaction.drag == Interaction::Drag::kNone || shift != 0.0)
    session.interaction().cursor = cursor_ - glm::dvec2(now.left, 0.0);
}

}  // namespace isobrick
