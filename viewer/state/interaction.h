// Events on a view: an event and a state give a state. No window, no OpenGL.
#pragma once

#include <array>
#include <glm/vec2.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/viewer/state/input_event.h"
#include "isobrick/viewer/state/scene_handles.h"
#include "isobrick/viewer/state/view_state.h"

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
  // Of the views with names (window/output_files.h).
  std::optional<std::string> save_named_view;  // empty: under a free name
  std::optional<std::string> show_named_view;  // empty: the one after the one shown last
  std::optional<std::string> remove_named_view;
  bool export_mesh = false;
  bool export_measurements = false;
  bool close = false;
  bool browse = false;                // the list of files to open, on and off
  bool stop_opening = false;          // cancels the opening under way, or its message
  std::optional<std::string> open;    // this path
  std::optional<std::size_t> choose;  // of the volumes in what is being opened
  std::optional<bool> answer;         // to a question (session/wish_guard.h)
};

void addWishes(const Wishes& more, Wishes& wishes);

// For the scale of a screen.
inline constexpr double kMostScale = 2.5;

// State that lasts from event to event, and belongs to no saved view.
struct Interaction {
  enum class Drag { kNone, kTurn, kPan, kZoom, kHandle, kPanel };
  enum class Tool { kNone, kDistance, kAngle, kPiece };

  glm::dvec2 size{1.0, 1.0};  // of the picture, pixels; 0 while there is none
  glm::dvec2 cursor{0.0};     // pixels
  double scale = 1.0;  // pixels of this screen that are one of an ordinary one, 1 .. kMostScale
  Drag drag = Drag::kNone;
  MouseButton drag_button = MouseButton::kLeft;
  glm::dvec2 pressed_at{0.0};            // pixels, at which the button went down
  std::optional<AxisView> pressed_face;  // of the cube
  std::optional<SceneHandle> held_handle;
  double first_pull = 0.0;  // of it, world units
  double last_click_seconds = -1e9;
  glm::dvec2 last_click{0.0};
  bool flying = false;
  bool playing = false;            // one step of time after the other
  Tool tool = Tool::kNone;         // that a click on the surface is for
  std::vector<glm::dvec3> picked;  // its points so far, world
  std::array<bool, kKeyCount> held{};
  bool show_help = false;
  bool show_panel = true;

  double aspect() const { return size.x > 0.0 && size.y > 0.0 ? size.x / size.y : 1.0; }
  PictureSize picture() const { return {size, scale}; }
  // A hand that moves less than this clicks.
  double clickPixels() const { return 5.0 * scale; }
  glm::dvec2 toPicture(const glm::dvec2& pixel) const;
};

// A press within this time of the last click, and as near, is a double click.
inline constexpr double kDoubleClickSeconds = 0.35;

// Applies the event to `interaction` and `state`. `seconds` is any clock that runs on; `on_panel`:
// the cursor, or the keyboard, is on a panel; a drag that begins there stays there.
Wishes applyEvent(const InputEvent& event, double seconds, bool on_panel, const ViewVolume& volume,
                  Interaction& interaction, ViewState& state);

// Moves a flying camera by the keys that are held: W, S, A, D, E (up), Q (down); Shift has no
// effect, the speed follows the size of the volume.
void advanceFlight(double seconds, const ViewVolume& volume, const Interaction& interaction,
                   ViewState& state);

// From the first of its points on.
void chooseTool(Interaction::Tool tool, Interaction& interaction);

// The next point of the tool, world; the last one adds the measurement.
void measureAt(const glm::dvec3& world, Interaction& interaction, ViewState& state);

// Focus and pivot at a point of the world.
void focusOn(const glm::dvec3& world, const ViewVolume& volume, ViewState& state);

// Adds a plane across a world axis through the focus, but no seventh one.
void addClipPlane(int axis, const ViewVolume& volume, ViewState& state);
// The same, or turns an existing one of that axis on or off.
void toggleClipPlane(int axis, const ViewVolume& volume, ViewState& state);

}  // namespace isobrick
