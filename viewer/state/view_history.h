// Views one after the other: those of a session, for undo and redo; a turntable; a path of the
// camera.
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

// Remembers the view whenever it rests: changes that follow each other within kRestSeconds, and all
// of a drag, are one step. Time is the caller's: seconds that run on.
class ViewHistory {
 public:
  static constexpr double kRestSeconds = 0.4;
  static constexpr std::size_t kMostViews = 200;  // older ones are forgotten

  // Changes all views that it remembers: f(ViewState&).
  template <typename F>
  void amend(F&& f) {
    for (ViewState& view : views_) f(view);
    if (changing_) f(*changing_);
  }
  // The view of this moment; `is_held`: the user drags or flies.
  void note(const ViewState& view, bool is_held, double seconds);

  // The view before `now`, or after it; none if there is none. What `now` has and note() has not
  // remembered yet is remembered first, so that redo() brings it back.
  std::optional<ViewState> undo(const ViewState& now);
  std::optional<ViewState> redo(const ViewState& now);

 private:
  void remember(const ViewState& view);

  std::deque<ViewState> views_;
  std::size_t at_ = 0;  // the place of the current one among them
  std::optional<ViewState> changing_;
  double changed_ = 0.0;  // when `changing_` last did
};

// `count` views all around the pivot, to the right, in equal steps from `view` on.
std::vector<ViewState> turntable(const ViewState& view, int count);

// The view a share 0 .. 1 of the way from `a` to `b`: the camera on the shorter way around, its
// distance by equal factors; focus, slices, isovalues, colours and opacities of as many surfaces,
// clip planes if there are as many, backgrounds. All else is that of `a`, before the end.
ViewState viewBetween(const ViewState& a, const ViewState& b, double share);

// `count` views (at least 2) in equal steps from the first of at least two stops to the last.
std::vector<ViewState> viewsAlong(const std::vector<ViewState>& stops, int count);

}  // namespace isobrick
