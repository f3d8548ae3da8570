#include "isobrick/viewer/state/interaction.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <optional>
#include <utility>

#include "isobrick/viewer/state/view_keys.h"

namespace isobrick {

void addWishes(const Wishes& more, Wishes& wishes) {
  const auto join = [](bool one, bool& other) { other = other || one; };
  if (more.focus_at) wishes.focus_at = more.focus_at;
  if (more.measure_at) wishes.measure_at = more.measure_at;
  if (more.piece_at) wishes.piece_at = more.piece_at;
  if (more.open) wishes.open = more.open;
  if (more.choose) wishes.choose = more.choose;
  if (more.answer) wishes.answer = more.answer;
  if (more.save_named_view) wishes.save_named_view = more.save_named_view;
  if (more.show_named_view) wishes.show_named_view = more.show_named_view;
  if (more.remove_named_view) wishes.remove_named_view = more.remove_named_view;
  join(more.keep_piece, wishes.keep_piece);
  join(more.hide_piece, wishes.hide_piece);
  join(more.frame_surfaces, wishes.frame_surfaces);
  join(more.first_view, wishes.first_view);
  join(more.undo, wishes.undo);
  join(more.redo, wishes.redo);
  join(more.screenshot, wishes.screenshot);
  join(more.screenshot_exr, wishes.screenshot_exr);
  join(more.save_state, wishes.save_state);
  join(more.load_state, wishes.load_state);
  join(more.export_mesh, wishes.export_mesh);
  join(more.export_measurements, wishes.export_measurements);
  join(more.close, wishes.close);
  join(more.browse, wishes.browse);
  join(more.stop_opening, wishes.stop_opening);
}

namespace {

constexpr double kDegreesPerPicture = 240.0;  // a drag over the height of the picture
constexpr double kZoomPerNotch = 0.88;
constexpr double kRadiusPerNotch = 1.12;

std::size_t number(Key key) { return static_cast<std::size_t>(key); }

double sizeOf(const ViewVolume& volume) {
  const WorldBox box = volume.box();
  return glm::length(box.upper - box.lower);
}

void zoomBy(double factor, const ViewVolume& volume, const Interaction& interaction,
            ViewState& state) {
  const double size = sizeOf(volume);
  state.camera = zoomed(state.camera, factor, interaction.toPicture(interaction.cursor),
                        interaction.aspect(), 1e-4 * size, 20.0 * size);
}

void drag(const glm::dvec2& pixels, const ViewVolume& volume, const Interaction& interaction,
          ViewState& state) {
  if (interaction.size.y <= 0.0) return;
  const glm::dvec2 degrees = pixels * (kDegreesPerPicture / interaction.size.y);
  switch (interaction.drag) {
    case Interaction::Drag::kTurn:
      state.camera = interaction.flying
                         ? lookedAround(state.camera, 0.25 * degrees.x, -0.25 * degrees.y)
                         : orbited(state.camera, -degrees.x, degrees.y);
      break;
    case Interaction::Drag::kPan:
      state.camera = panned(state.camera, 2.0 * glm::dvec2(pixels.x, -pixels.y) / interaction.size,
                            interaction.aspect());
      break;
    case Interaction::Drag::kZoom:
      zoomBy(std::exp(4.0 * pixels.y / interaction.size.y), volume, interaction, state);
      break;
    case Interaction::Drag::kHandle: {
      const auto pulled =
          pullOf(*interaction.held_handle, state.camera, interaction.picture(), interaction.cursor);
      if (pulled) pull(*interaction.held_handle, *pulled - interaction.first_pull, volume, state);
      break;
    }
    case Interaction::Drag::kNone:
    case Interaction::Drag::kPanel:
      break;
  }
}

Interaction::Drag dragOf(const InputEvent& event) {
  if (event.button == MouseButton::kLeft)
    return event.shift ? Interaction::Drag::kPan : Interaction::Drag::kTurn;
  return event.button == MouseButton::kMiddle ? Interaction::Drag::kPan : Interaction::Drag::kZoom;
}

// True if the user took a handle or the cube.
bool takeHold(const ViewVolume& volume, const ViewState& state, Interaction& interaction) {
  const PictureSize picture = interaction.picture();
  interaction.pressed_face = cubeFaceAt(cubeFacesOf(state.camera, picture), interaction.cursor);
  if (interaction.pressed_face) return true;
  const auto handle =
      handleAt(handlesOf(state, volume, picture), interaction.cursor, interaction.scale);
  if (!handle) return false;
  const auto pulled = pullOf(*handle, state.camera, picture, interaction.cursor);
  if (!pulled) return false;
  interaction.drag = Interaction::Drag::kHandle;
  interaction.held_handle = handle;
  interaction.first_pull = handle->kind == SceneHandle::Kind::kRadius ? 0.0 : *pulled;
  return true;
}

void press(const InputEvent& event, double seconds, bool on_panel, const ViewVolume& volume,
           const ViewState& state, Interaction& interaction, Wishes& wishes) {
  if (interaction.drag != Interaction::Drag::kNone) return;  // another button goes on
  interaction.drag = on_panel ? Interaction::Drag::kPanel : dragOf(event);
  interaction.drag_button = event.button;
  interaction.pressed_at = interaction.cursor;
  interaction.pressed_face.reset();
  if (on_panel || event.button != MouseButton::kLeft || event.shift) return;
  if (takeHold(volume, state, interaction)) return;
  // In slow frames both clicks are noticed late: the least time between them counts.
  const double at = event.seconds.value_or(seconds);
  const bool quick =
      at - event.waited - interaction.last_click_seconds <= kDoubleClickSeconds &&
      glm::distance(interaction.cursor, interaction.last_click) <= interaction.clickPixels();
  // A tool takes single clicks.
  const bool again = (quick || event.clicks == 2) && interaction.tool == Interaction::Tool::kNone;
  if (again) wishes.focus_at = interaction.cursor;
  interaction.last_click_seconds = again ? -1e9 : at;
  interaction.last_click = interaction.cursor;
}

void release(const InputEvent& event, Interaction& interaction, ViewState& state, Wishes& wishes) {
  if (event.button != interaction.drag_button) return;
  const Interaction::Drag drag = std::exchange(interaction.drag, Interaction::Drag::kNone);
  const bool is_click =
      glm::distance(interaction.cursor, interaction.pressed_at) <= interaction.clickPixels();
  if (is_click && interaction.pressed_face)
    state.camera = alongAxis(state.camera, *interaction.pressed_face);
  else if (is_click && drag == Interaction::Drag::kTurn &&
           interaction.tool != Interaction::Tool::kNone)
    (interaction.tool == Interaction::Tool::kPiece ? wishes.piece_at : wishes.measure_at) =
        interaction.cursor;
  interaction.pressed_face.reset();
}

void wheel(const InputEvent& event, const ViewVolume& volume, const Interaction& interaction,
           ViewState& state) {
  if (!event.control)
    return zoomBy(std::pow(kZoomPerNotch, event.amount), volume, interaction, state);
  state.focus.everywhere = false;
  state.focus.radius *= std::pow(kRadiusPerNotch, event.amount);
  state = bounded(state, volume);
}

}  // namespace

glm::dvec2 Interaction::toPicture(const glm::dvec2& pixel) const {
  if (size.x <= 0.0 || size.y <= 0.0) return glm::dvec2(0.0);
  return {2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y};
}

Wishes applyEvent(const InputEvent& event, double seconds, bool on_panel, const ViewVolume& volume,
                  Interaction& interaction, ViewState& state) {
  Wishes wishes;
  switch (event.kind) {
    case InputEvent::Kind::kMove: {
      const glm::dvec2 to(event.x, event.y);
      const glm::dvec2 by = to - interaction.cursor;
      interaction.cursor = to;
      drag(by, volume, interaction, state);
      break;
    }
    case InputEvent::Kind::kPress:
      press(event, seconds, on_panel, volume, state, interaction, wishes);
      break;
    case InputEvent::Kind::kRelease:
      release(event, interaction, state, wishes);
      break;
    case InputEvent::Kind::kWheel:
      if (!on_panel) wheel(event, volume, interaction, state);
      break;
    case InputEvent::Kind::kKeyPress:
      interaction.held[number(event.key)] = !on_panel && !event.control;
      if (!on_panel) pressKey(event, volume, interaction, state, wishes);
      break;
    case InputEvent::Kind::kKeyRelease:
      interaction.held[number(event.key)] = false;
      break;
    case InputEvent::Kind::kText:
      break;  // for panels
    case InputEvent::Kind::kRefresh:
      break;  // it brings a frame
    case InputEvent::Kind::kResize:
      interaction.size = {std::max(event.x, 0.0), std::max(event.y, 0.0)};
      break;
    case InputEvent::Kind::kClose:
      wishes.close = true;
      break;
    case InputEvent::Kind::kOpen:
      wishes.open = event.path;
      break;
  }
  if (state.focus.follow_view) state = bounded(state, volume);
  return wishes;
}

void advanceFlight(double seconds, const ViewVolume& volume, const Interaction& interaction,
                   ViewState& state) {
  if (!interaction.flying) return;
  const auto held = [&](Key key) { return interaction.held[number(key)] ? 1.0 : 0.0; };
  const glm::dvec3 direction(held(Key::kD) - held(Key::kA), held(Key::kE) - held(Key::kQ),
                             held(Key::kW) - held(Key::kS));
  if (direction == glm::dvec3(0.0)) return;
  constexpr double kVolumesPerSecond = 0.2;
  state.camera = flown(state.camera, direction * (kVolumesPerSecond * sizeOf(volume) * seconds));
  if (state.focus.follow_view) state = bounded(state, volume);
}

void chooseTool(Interaction::Tool tool, Interaction& interaction) {
  interaction.tool = tool;
  interaction.picked.clear();
}

void measureAt(const glm::dvec3& world, Interaction& interaction, ViewState& state) {
  if (interaction.tool == Interaction::Tool::kNone || interaction.tool == Interaction::Tool::kPiece)
    return;
  if (state.measurements.size() >= kMostMeasurements) return;  // the foot line says so
  interaction.picked.push_back(world);
  const std::size_t wanted = interaction.tool == Interaction::Tool::kAngle ? 3 : 2;
  if (interaction.picked.size() < wanted) return;
  state.measurements.push_back({std::move(interaction.picked)});
  interaction.picked.clear();
}

void focusOn(const glm::dvec3& world, const ViewVolume& volume, ViewState& state) {
  state.focus.center = volume.geometry.worldToIndex(world);
  state.camera = turningAbout(state.camera, world);
  state = bounded(state, volume);
}

void addClipPlane(int axis, const ViewVolume& volume, ViewState& state) {
  if (state.clip_planes.size() == kMostClipPlanes) return;
  ViewClipPlane& plane = state.clip_planes.emplace_back();
  plane.normal = glm::dvec3(0.0);
  plane.normal[axis] = 1.0;
  plane.offset = volume.geometry.indexToWorld(state.focus.center)[axis];
}

void toggleClipPlane(int axis, const ViewVolume& volume, ViewState& state) {
  for (ViewClipPlane& plane : state.clip_planes) {
    if (std::abs(plane.normal[axis]) == 1.0) {
      plane.enabled = !plane.enabled;
      return;
    }
  }
  addClipPlane(axis, volume, state);
}

}  // namespace isobrick
