// The sections of the panel that change what is shown, as things to drag and to type in.
#pragma once

#include "isobrick/viewer/session/view_session.h"

namespace isobrick {

// Into the window of Dear ImGui that is being built. Changes the session's state as the user asks.
// `scale`: pixels of this screen that are one of an ordinary one.
Wishes buildControls(ViewSession& session, float scale);

}  // namespace isobrick
