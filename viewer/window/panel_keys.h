// The keyboard of Dear ImGui, which until 1.88 has a table of keys and later is told of each
// change.
#pragma once

#include <imgui.h>

#include "isobrick/viewer/state/input_event.h"

namespace isobrick {

// Of the current context, once, before its first frame.
void setUpPanelKeys();

// The next frame sees it. Keys that no panel knows are left out.
void setPanelKey(Key key, bool is_down);
void setPanelModifiers(bool shift, bool control);

// In this frame, not by repetition.
bool isPanelKeyPressed(ImGuiKey key);

}  // namespace isobrick
