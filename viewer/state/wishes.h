// What the user asks of the owner of a renderer and files.
#pragma once

#include <glm/vec2.hpp>
#include <optional>
#include <string>

namespace isobrick {

// The wishes of an event to the owner of a renderer and files.
struct Wishes {
  std::optional<glm::dvec2> focus_at;    // the surface under this pixel becomes focus and pivot
  std::optional<glm::dvec2> measure_at;  // the surface under this pixel is the tool's next point
  std::optional<glm::dvec2> piece_at;    // the piece of the surface under this pixel is picked
  bool keep_piece = false;               // of the active surface only the picked piece
  bool hide_piece = false;               // the picked piece goes
  bool frame_surfaces = false;           // all that is shown of them
  bool first_view = false;               // the one that the volume was opened with
  bool undo = false;
  bool redo = false;
  bool screenshot = false;
  bool screenshot_exr = false;  // with depth and normals
  bool save_state = false;
  bool load_state = false;
  // Of the views with names (window/named_views.h).
  std::optional<std::string> save_named_view;  // empty: under a free name
  std::optional<std::string> show_named_view;  // empty: the one after the one shown last
  std::optional<std::string> remove_named_view;
  bool export_mesh = false;
  bool export_measurements = false;
  bool close = false;
  bool browse = false;              // the list of files to open, on and off
  bool stop_opening = false;        // cancels the opening under way, or its message
  std::optional<std::string> open;  // this path
  std::optional<bool> answer;       // to a question (session/wish_guard.h)
};

// Adds the wishes of `more` to `wishes`.
void addWishes(const Wishes& more, Wishes& wishes);

}  // namespace isobrick
