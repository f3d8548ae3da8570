#include "isobrick/viewer/state/view_keys.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <optional>

namespace isobrick {
namespace {

struct KeyPress {
  const InputEvent& event;
  const ViewVolume& volume;
  Interaction& interaction;
  ViewState& state;
  Wishes& wishes;
};

struct KeyBinding {
  Key key;
  void (*act)(const KeyPress& press);
  bool control = false;
  // A key that is held goes on: not with what writes a file, nor with leaving, of which twice is a
  // yes.
  bool repeats = false;
};
constexpr bool kControl = true, kRepeats = true;

// A line of the help, and its keys.
struct KeyRow {
  KeyHelp help;
  std::vector<KeyBinding> bindings = {};
};

void flip(bool& flag) { flag = !flag; }

void moveIsovalue(double steps, const KeyPress& press) {
  activeSurface(press.state).isovalue +=
      (press.event.shift ? 10.0 : 1.0) * steps * isovalueStep(press.volume);
  press.state = bounded(press.state, press.volume);
}

void switchTool(Interaction::Tool tool, const KeyPress& press) {
  const bool is_on = press.interaction.tool == tool;
  chooseTool(is_on ? Interaction::Tool::kNone : tool, press.interaction);
}

bool picks(const KeyPress& press) { return press.interaction.tool == Interaction::Tool::kPiece; }

// Around the sphere of interest, as far as it is in the volume.
WorldBox boxOfFocus(const ViewVolume& volume, const ViewState& state) {
  const glm::dvec3 last(volume.voxels - Index3(1));
  const glm::dvec3 lower = glm::max(state.focus.center - state.focus.radius, glm::dvec3(0.0));
  const glm::dvec3 upper = glm::min(state.focus.center + state.focus.radius, last);
  return volume.boxAround(lower, upper);
}

void frameIt(const KeyPress& press) {
  if (press.event.shift)
    press.state.camera = framed(press.state.camera, boxOfFocus(press.volume, press.state),
                                press.interaction.aspect());
  else
    press.wishes.frame_surfaces = true;
}

void endTools(const KeyPress& press) {
  press.interaction.flying = press.interaction.show_help = false;
  chooseTool(Interaction::Tool::kNone, press.interaction);
}

void takeLastBack(const KeyPress& press) {
  if (!press.interaction.picked.empty())
    press.interaction.picked.pop_back();
  else if (!press.state.measurements.empty())
    press.state.measurements.pop_back();
}

void turnClipPlaneRound(const KeyPress& press) {
  if (press.state.clip_planes.empty()) return;
  ViewClipPlane& plane = press.state.clip_planes.back();
  plane.normal = -plane.normal;
  plane.offset = -plane.offset;
}

void writePicture(const KeyPress& press) {
  (press.event.shift ? press.wishes.screenshot_exr : press.wishes.screenshot) = true;
}

void writeView(const KeyPress& press) {
  if (press.event.shift)
    press.wishes.save_named_view.emplace();
  else
    press.wishes.save_state = true;
}

template <AxisView kFrom>
void lookFrom(const KeyPress& press) {
  press.state.camera = alongAxis(press.state.camera, kFrom);
}

template <int kAxis>
void cutAcross(const KeyPress& press) {
  toggleClipPlane(kAxis, press.volume, press.state);
}

const std::vector<KeyRow>& keyRows() {
  using Press = const KeyPress&;
  using Tool = Interaction::Tool;
  static const std::vector<KeyRow> rows{
      {{"left drag", "turn"}},
      {{"middle or Shift+left drag", "move sideways"}},
      {{"right drag, wheel", "zoom towards the cursor"}},
      {{"Ctrl+wheel", "region of interest, its radius"}},
      {{"double click", "turn about the surface there, and focus on it"}},
      {{"left, right arrow",
        "isovalue by a thousandth of the range or less; with Shift by 10 of them"},
       {{Key::kLeft, [](Press p) { moveIsovalue(-1.0, p); }, false, kRepeats},
        {Key::kRight, [](Press p) { moveIsovalue(1.0, p); }, false, kRepeats}}},
      {{"up, down arrow; J", "the next step of time, the one before; play them, and stop"},
       {{Key::kUp, [](Press p) { ++p.state.step; }, false, kRepeats},
        {Key::kDown, [](Press p) { --p.state.step; }, false, kRepeats},
        {Key::kJ, [](Press p) { flip(p.interaction.playing); }}}},
      {{"R", "the next isovalue that is suggested"},
       {{Key::kR, [](Press p) { stepIsovalue(p.volume, p.state); }}}},
      {{"F, Shift+F", "see all of the surface; the focus"}, {{Key::kF, frameIt}}},
      {{"Ctrl+Z, Ctrl+Shift+Z, Home", "undo, redo; the first view"},
       {{Key::kZ, [](Press p) { (p.event.shift ? p.wishes.redo : p.wishes.undo) = true; }, kControl,
         kRepeats},
        {Key::kY, [](Press p) { p.wishes.redo = true; }, kControl, kRepeats},
        {Key::kHome, [](Press p) { p.wishes.first_view = true; }}}},
      {{"keypad 1, 3, 7", "from the front, the right, the top; with Ctrl from behind"},
       {{Key::kPad1, lookFrom<AxisView::kFront>},
        {Key::kPad1, lookFrom<AxisView::kBack>, kControl},
        {Key::kPad3, lookFrom<AxisView::kRight>},
        {Key::kPad3, lookFrom<AxisView::kLeft>, kControl},
        {Key::kPad7, lookFrom<AxisView::kTop>},
        {Key::kPad7, lookFrom<AxisView::kBottom>, kControl}}},
      {{"keypad 5 or O", "orthographic or perspective"},
       {{Key::kPad5, [](Press p) { flip(p.state.camera.orthographic); }},
        {Key::kO, [](Press p) { flip(p.state.camera.orthographic); }}}},
      {{"arrows in the scene", "drag the focus, or a clip plane"}},
      {{"cube", "from that side; drag it to turn"}},
      {{"T", "the arrows on and off"}, {{Key::kT, [](Press p) { flip(p.state.show_handles); }}}},
      {{"V", "the focus follows the view, or stays"},
       {{Key::kV, [](Press p) { flip(p.state.focus.follow_view); }}}},
      {{"G", "fly: W A S D E Q; the mouse looks around; Esc or G ends it"},
       {{Key::kG, [](Press p) { flip(p.interaction.flying); }}, {Key::kEscape, endTools}}},
      {{"D, A", "measure a distance, an angle: click on the surface; Esc ends it"},
       {{Key::kD, [](Press p) { switchTool(Tool::kDistance, p); }},
        {Key::kA, [](Press p) { switchTool(Tool::kAngle, p); }}}},
      {{"K", "pick a piece: click on the surface; Enter keeps only that one, Delete hides it"},
       {{Key::kK, [](Press p) { switchTool(Tool::kPiece, p); }},
        {Key::kEnter, [](Press p) { p.wishes.keep_piece = picks(p); }},
        {Key::kDelete, [](Press p) { p.wishes.hide_piece = picks(p); }}}},
      {{"Backspace", "takes the last point, or measurement, back"},
       {{Key::kBackspace, takeLastBack}}},
      {{"W", "wireframe"}, {{Key::kW, [](Press p) { flip(p.state.wireframe); }}}},
      {{"C", "colour by level"},
       {{Key::kC,
         [](Press p) {
           const bool is_plain = p.state.coloring == ViewColoring::kPlain;
           p.state.coloring = is_plain ? ViewColoring::kLevel : ViewColoring::kPlain;
         }}}},
      {{"L", "three lights or a headlight"},
       {{Key::kL,
         [](Press p) {
           const bool are_three = p.state.lighting == ViewLighting::kThreeLights;
           p.state.lighting = are_three ? ViewLighting::kHeadlight : ViewLighting::kThreeLights;
         }}}},
      {{"B", "the box"}, {{Key::kB, [](Press p) { flip(p.state.show_box); }}}},
      {{"S", "the region of interest"},
       {{Key::kS, [](Press p) { flip(p.state.focus.show_sphere); }}}},
      {{"X, Y, Z", "a clip plane across that axis through the focus, on and off"},
       {{Key::kX, cutAcross<0>}, {Key::kY, cutAcross<1>}, {Key::kZ, cutAcross<2>}}},
      {{"I", "turn the last clip plane round"}, {{Key::kI, turnClipPlaneRound}}},
      {{"U", "the slices in three views beside the scene; right drag there: black and white"},
       {{Key::kU, [](Press p) { flip(p.state.slice_views.shown); }}}},
      {{"P or F12", "write a picture; with Shift as EXR, with depth and normals"},
       {{Key::kP, writePicture}, {Key::kF12, writePicture}}},
      {{"M", "write the mesh"}, {{Key::kM, [](Press p) { p.wishes.export_mesh = true; }}}},
      {{"N", "open another volume; so does dropping one on the window"},
       {{Key::kN, [](Press p) { p.wishes.browse = true; }}}},
      {{"Ctrl+S, Ctrl+O", "write the view, read it again"},
       {{Key::kS, writeView, kControl},
        {Key::kO, [](Press p) { p.wishes.load_state = true; }, kControl}}},
      {{"Ctrl+Shift+S, Ctrl+R", "save the view under a new name; the next view that has a name"},
       {{Key::kR, [](Press p) { p.wishes.show_named_view.emplace(); }, kControl}}},
      {{"Tab", "the panel"}, {{Key::kTab, [](Press p) { flip(p.interaction.show_panel); }}}},
      {{"H", "this list"}, {{Key::kH, [](Press p) { flip(p.interaction.show_help); }}}},
      {{"Ctrl+Q", "leave"}, {{Key::kQ, [](Press p) { p.wishes.close = true; }, kControl}}},
  };
  return rows;
}

bool fliesWith(Key key) {
  constexpr Key kFlight[] = {Key::kW, Key::kA, Key::kS, Key::kD, Key::kE, Key::kQ};
  return std::ranges::find(kFlight, key) != std::end(kFlight);
}

}  // namespace

void pressKey(const InputEvent& event, const ViewVolume& volume, Interaction& interaction,
              ViewState& state, Wishes& wishes) {
  if (!event.control && interaction.flying && fliesWith(event.key)) return;
  const KeyPress press{event, volume, interaction, state, wishes};
  for (const KeyRow& row : keyRows())
    for (const KeyBinding& binding : row.bindings)
      if (binding.key == event.key && binding.control == event.control &&
          (binding.repeats || !event.repeated))
        return binding.act(press);
}

std::vector<KeyHelp> keyHelp() {
  std::vector<KeyHelp> help;
  for (const KeyRow& row : keyRows()) help.push_back(row.help);
  return help;
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
