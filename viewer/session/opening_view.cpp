#include "isobrick/viewer/session/opening_view.h"

#include <algorithm>

namespace isobrick {

void OpeningView::follow(const OpeningView& preview) {
  frames_ = frames_ && preview.frames_;
  chooses_focus_ = chooses_focus_ && preview.chooses_focus_;
  framed_ = preview.framed_;
}

void OpeningView::update(const Sight& sight, const ViewVolume& volume, double aspect,
                         ViewState& state) {
  frames_ = frames_ && state.camera == view_.camera;
  chooses_focus_ = chooses_focus_ && state.focus == view_.focus;
  if (sight.radius != radius_) {
    radius_ = sight.radius;
    drawings_ = {};
  }
  if (chooses_focus_ && !sight.is_preview) {
    if (sight.box)
      chooseFocus(sight);
    else if (sight.is_whole)
      chooses_focus_ = false;  // there is no surface
    state.focus = view_.focus;
  }
  if (framed_ && state.camera != *framed_) framed_.reset();  // the user's
  if (!frames_ && !framed_) return;
  state.camera = framed(state.camera, sight.box.value_or(volume.box()), aspect);
  if (frames_) {
    view_.camera = state.camera;
    has_framed_ = true;
    frames_ = !sight.is_whole;
  }
  if (framed_) framed_ = sight.is_whole ? std::nullopt : std::optional(state.camera);
}

void OpeningView::chooseFocus(const Sight& sight) {
  // The first picture compiles shaders, so two have to be slow.
  const bool draws_slowly = std::min(drawings_[0], drawings_[1]).value_or(0.0) > kDrawingSeconds;
  const bool extracts_slowly = sight.extraction_seconds > kExtractionSeconds;
  const bool waits = !sight.is_whole && sight.waited > kWaitSeconds;
  const bool too_much =
      draws_slowly || sight.over_budget || (!sight.is_whole && (extracts_slowly || waits));
  if (too_much) {
    view_.focus.everywhere = false;
    view_.focus.radius = draws_slowly ? 0.5 * sight.radius : sight.radius;
    limit_ = sight.over_budget ? "all of the surface does not fit on the card"
             : draws_slowly    ? "all of the surface is drawn too slowly here"
                               : "all of the surface takes long here";
    limit_ += ": fine within the sphere";
  }
  const bool is_drawn = drawings_[1] && *drawings_[1] <= kDrawingSeconds;
  chooses_focus_ = !too_much && !(sight.is_whole && is_drawn);
}

void OpeningView::noteDrawing(std::optional<double> seconds) {
  drawings_ = {drawings_[1], seconds.value_or(0.0)};
}

std::string OpeningView::limit(const ViewState& state) const {
  return state.focus == view_.focus ? limit_ : std::string();
}

}  // namespace isobrick
