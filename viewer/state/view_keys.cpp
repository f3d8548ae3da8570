#include "isobrick/viewer/state/view_keys.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <optional>
#include <utility>

namespace isobrick {
namespace {

void moveIsovalue(double step, const ViewVolume& volume, ViewState& state) {
  activeSurface(state).isovalue += step;
  state = bounded(state, volume);
}

void controlKey(const InputEvent& event, Wishes& wishes) {
  switch (event.key) {
    case Key::kZ:
      (event.shift ? wishes.redo : wishes.undo) = true;
      break;
    case Key::kY:
      wishes.redo = true;
      break;
    case Key::kS:
      if (event.shift)
        wishes.save_named_view.emplace();
      else
        wishes.save_state = true;
      break;
    case Key::kR:
      wishes.show_named_view.emplace();
      break;
    case Key::kO:
      wishes.load_state = true;
      break;
    case Key::kQ:
      wishes.close = true;
      break;
    default:
      break;
  }
}

bool fliesWith(Key key) {
  return key == Key::kW || key == Key::kA || key == Key::kS || key == Key::kD || key == Key::kE ||
         key == Key::kQ;
}

// The views from the keypad, which Ctrl turns round.
bool lookFrom(Key key, bool control, ViewState& state) {
  constexpr std::pair<Key, std::array<AxisView, 2>> kViews[] = {
      {Key::kPad1, {AxisView::kFront, AxisView::kBack}},
      {Key::kPad3, {AxisView::kRight, AxisView::kLeft}},
      {Key::kPad7, {AxisView::kTop, AxisView::kBottom}}};
  for (const auto& [view_key, views] : kViews)
    if (key == view_key) {
      state.camera = alongAxis(state.camera, views[control ? 1 : 0]);
      return true;
    }
  return false;
}

// A key that is held goes on with these alone: leaving twice is a yes, and no file is written
// twice.
bool isStep(const InputEvent& event) {
  return event.control ? event.key == Key::kZ || event.key == Key::kY
                       : event.key == Key::kLeft || event.key == Key::kRight;
}

// The keys that switch something on and off, or wish for it.
void toggle(Key key, Interaction& interaction, ViewState& state, Wishes& wishes) {
  const std::pair<Key, bool*> toggles[] = {{Key::kPad5, &state.camera.orthographic},
                                           {Key::kO, &state.camera.orthographic},
                                           {Key::kG, &interaction.flying},
                                           {Key::kW, &state.wireframe},
                                           {Key::kB, &state.show_box},
                                           {Key::kU, &state.slice_views.shown},
                                           {Key::kS, &state.focus.show_sphere},
                                           {Key::kT, &state.show_handles},
                                           {Key::kV, &state.focus.follow_view},
                                           {Key::kTab, &interaction.show_panel},
                                           {Key::kH, &interaction.show_help}};
  for (const auto& [toggle_key, flag] : toggles)
    if (key == toggle_key) *flag = !*flag;
  const std::pair<Key, bool*> plain_wishes[] = {
      {Key::kHome, &wishes.first_view}, {Key::kM, &wishes.export_mesh}, {Key::kN, &wishes.browse}};
  for (const auto& [wish_key, wish] : plain_wishes)
    if (key == wish_key) *wish = true;
}

void switchTool(Interaction::Tool tool, Interaction& interaction) {
  chooseTool(interaction.tool == tool ? Interaction::Tool::kNone : tool, interaction);
}

// The keys of the tools.
void toolKey(const InputEvent& event, Interaction& interaction, ViewState& state, Wishes& wishes) {
  switch (event.key) {
    case Key::kEscape:
      interaction.flying = interaction.show_help = false;
      chooseTool(Interaction::Tool::kNone, interaction);
      break;
    case Key::kD:
      switchTool(Interaction::Tool::kDistance, interaction);
      break;
    case Key::kA:
      switchTool(Interaction::Tool::kAngle, interaction);
      break;
    case Key::kK:
      switchTool(Interaction::Tool::kPiece, interaction);
      break;
    case Key::kEnter:
      wishes.keep_piece = interaction.tool == Interaction::Tool::kPiece;
      break;
    case Key::kDelete:
      wishes.hide_piece = interaction.tool == Interaction::Tool::kPiece;
      break;
    case Key::kBackspace:
      if (!interaction.picked.empty())
        interaction.picked.pop_back();
      else if (!state.measurements.empty())
        state.measurements.pop_back();
      break;
    default:
      break;
  }
}

// Around the sphere of interest, as far as it is in the volume.
WorldBox boxOfFocus(const ViewVolume& volume, const ViewState& state) {
  const glm::dvec3 last(volume.voxels - Index3(1));
  const glm::dvec3 lower = glm::max(state.focus.center - state.focus.radius, glm::dvec3(0.0));
  const glm::dvec3 upper = glm::min(state.focus.center + state.focus.radius, last);
  return volume.boxAround(lower, upper);
}

void plainKey(const InputEvent& event, const ViewVolume& volume, Interaction& interaction,
              ViewState& state, Wishes& wishes) {
  const double step = (event.shift ? 10.0 : 1.0) * isovalueStep(volume);
  if (event.key == Key::kLeft) return moveIsovalue(-step, volume, state);
  if (event.key == Key::kRight) return moveIsovalue(step, volume, state);
  if (interaction.flying && fliesWith(event.key)) return;
  if (lookFrom(event.key, false, state)) return;
  toggle(event.key, interaction, state, wishes);
  toolKey(event, interaction, state, wishes);
  switch (event.key) {
    case Key::kF:
      if (event.shift)
        state.camera = framed(state.camera, boxOfFocus(volume, state), interaction.aspect());
      else
        wishes.frame_surfaces = true;
      break;
    case Key::kR:
      stepIsovalue(volume, state);
      break;
    case Key::kC:
      state.coloring =
          state.coloring == ViewColoring::kPlain ? ViewColoring::kLevel : ViewColoring::kPlain;
      break;
    case Key::kL:
      state.lighting = state.lighting == ViewLighting::kThreeLights ? ViewLighting::kHeadlight
                                                                    : ViewLighting::kThreeLights;
      break;
    case Key::kX:
    case Key::kY:
    case Key::kZ:
      toggleClipPlane(static_cast<int>(event.key) - static_cast<int>(Key::kX), volume, state);
      break;
    case Key::kI:
      if (!state.clip_planes.empty()) {
        state.clip_planes.back().normal = -state.clip_planes.back().normal;
        state.clip_planes.back().offset = -state.clip_planes.back().offset;
      }
      break;
    case Key::kP:
    case Key::kF12:
      (event.shift ? wishes.screenshot_exr : wishes.screenshot) = true;
      break;
    default:
      break;
  }
}

}  // namespace

void pressKey(const InputEvent& event, const ViewVolume& volume, Interaction& interaction,
              ViewState& state, Wishes& wishes) {
  if (event.repeated && !isStep(event)) return;
  if (!event.control)
    plainKey(event, volume, interaction, state, wishes);
  else if (!lookFrom(event.key, true, state))
    controlKey(event, wishes);
}

double isovalueStep(const ViewVolume& volume) {
  const double span = volume.greatest_value - volume.least_value;
  if (!(span > 0.0) || !std::isfinite(span)) return 1.0;
  return std::pow(10.0, std::floor(std::log10(1e-3 * span) + 1e-9));
}

void stepIsovalue(const ViewVolume& volume, ViewState& state) {
  if (volume.isovalues.empty()) return;
  double& isovalue = activeSurface(state).isovalue;
  std::optional<double> next;
  for (const double value : volume.isovalues)
    if (value > isovalue && (!next || value < *next)) next = value;
  isovalue = next.value_or(*std::min_element(volume.isovalues.begin(), volume.isovalues.end()));
}

}  // namespace isobrick
