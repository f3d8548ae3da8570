// The view that a volume opens with, until the user changes it.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

// Frames the surface as it comes, and decides how fine it is shown: all of it on level 0, or, if
// that takes long here, a region of interest. The focus is the user's from its first change on, and
// so is the camera.
class OpeningView {
 public:
  // After a pass, or pictures, that took longer the surface grows no finer: seconds of extraction,
  // of waiting for a pass with its bricks read, and of drawing.
  static constexpr double kExtractionSeconds = 0.3;
  static constexpr double kWaitSeconds = 2.0;
  static constexpr double kDrawingSeconds = 1.0;

  struct Sight {
    std::optional<WorldBox> box;      // around it; none: nothing is shown
    double radius = 0.0;              // of its pass, voxels
    double extraction_seconds = 0.0;  // of its pass, in bricks that were in memory; else 0
    double waited = 0.0;              // seconds since it came, for the next one
    bool over_budget = false;         // the next one has no room on the card
    bool is_whole = false;            // no finer one will come
    bool is_preview = false;          // it says nothing of how long all of the volume takes
  };

  explicit OpeningView(const ViewState& first) : view_(first) {}

  // The user's camera and focus of a preview of the same volume stay the user's.
  void follow(const OpeningView& preview);
  void restart() { frames_ = chooses_focus_ = true; }
  // Frames the surface of another view by this camera.
  void frame(const ViewCamera& camera) { framed_ = camera; }

  // Changes camera and focus of `state`, in a picture of `aspect`, and of view().
  void update(const Sight& sight, const ViewVolume& volume, double aspect, ViewState& state);
  // Of a picture of the surface that the last update() saw; none: it could not be drawn.
  void noteDrawing(std::optional<double> seconds);

  void keepFocus() { chooses_focus_ = false; }
  void end() {
    frames_ = chooses_focus_ = false;
    framed_.reset();
  }
  bool isOver() const { return !frames_ && !chooses_focus_ && !framed_; }
  bool hasFramed() const { return has_framed_; }
  const ViewState& view() const { return view_; }
  // Why `state` shows a region of interest, one line; empty: it does not, or the user chose it.
  std::string limit(const ViewState& state) const;

 private:
  void chooseFocus(const Sight& sight);

  ViewState view_;
  bool frames_ = true, chooses_focus_ = true;
  bool has_framed_ = false;
  std::optional<ViewCamera> framed_;  // of another view, while it is framed
  std::string limit_;
  double radius_ = 0.0;                            // of the surface in the pictures below
  std::array<std::optional<double>, 2> drawings_;  // seconds of the last two, the last one second
};

}  // namespace isobrick
