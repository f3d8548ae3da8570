// The keys of the viewer: a key and a state give a state, and wishes.
#pragma once

#include <vector>

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

// The keys, and what is done with the mouse, for the help window.
struct KeyHelp {
  const char* keys;
  const char* what;
};
std::vector<KeyHelp> keyHelp();

}  // namespace isobrick
