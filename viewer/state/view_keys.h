// The keys of the viewer: a key and a state give a state, and wishes.
#pragma once

#include "isobrick/viewer/state/interaction.h"

namespace isobrick {

// Applies a key that was pressed to `interaction` and `state`; its wishes are added to `wishes`.
void pressKey(const InputEvent& event, const ViewVolume& volume, Interaction& interaction,
              ViewState& state, Wishes& wishes);

// The least step of an isovalue by hand: the greatest power of ten of which the volume's range has
// at least a thousand. With Shift ten of them.
double isovalueStep(const ViewVolume& volume);

// The next greater one of the isovalues that are suggested, after the greatest the least, for the
// active surface. Changes nothing if none is suggested.
void stepIsovalue(const ViewVolume& volume, ViewState& state);

// The keys and what they do, for the help window and the documentation.
struct KeyHelp {
  const char* keys;
  const char* what;
};
inline constexpr KeyHelp kKeyHelp[] = {
    {"left drag", "turn"},
    {"middle or Shift+left drag", "move sideways"},
    {"right drag, wheel", "zoom towards the cursor"},
    {"Ctrl+wheel", "region of interest, its radius"},
    {"double click", "turn about the surface there, and focus on it"},
    {"left, right arrow",
     "isovalue by a thousandth of the range or less; with Shift by 10 of them"},
    {"R", "the next isovalue that is suggested"},
    {"F, Shift+F", "see all of the surface; the focus"},
    {"Ctrl+Z, Ctrl+Shift+Z, Home", "undo, redo; the first view"},
    {"keypad 1, 3, 7", "from the front, the right, the top; with Ctrl from behind"},
    {"keypad 5 or O", "orthographic or perspective"},
    {"arrows in the scene", "drag the focus, or a clip plane"},
    {"cube", "from that side; drag it to turn"},
    {"T", "the arrows on and off"},
    {"V", "the focus follows the view, or stays"},
    {"G", "fly: W A S D E Q; the mouse looks around; Esc or G ends it"},
    {"D, A", "measure a distance, an angle: click on the surface; Esc ends it"},
    {"K", "pick a piece: click on the surface; Enter keeps only that one, Delete hides it"},
    {"Backspace", "takes the last point, or measurement, back"},
    {"W", "wireframe"},
    {"C", "colour by level"},
    {"L", "three lights or a headlight"},
    {"B", "the box"},
    {"S", "the region of interest"},
    {"X, Y, Z", "a clip plane across that axis through the focus, on and off"},
    {"I", "turn the last clip plane round"},
    {"U", "the slices in three views beside the scene; right drag there: black and white"},
    {"P or F12", "write a picture; with Shift as EXR, with depth and normals"},
    {"M", "write the mesh"},
    {"N", "open another volume; so does dropping one on the window"},
    {"Ctrl+S, Ctrl+O", "write the view, read it again"},
    {"Ctrl+Shift+S, Ctrl+R", "save the view under a new name; the next view that has a name"},
    {"Tab", "the panel"},
    {"H", "this list"},
    {"Ctrl+Q", "leave"},
};

}  // namespace isobrick
