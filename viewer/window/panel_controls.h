// The parts of the panel, each into the window of Dear ImGui that is being built. They apply the
// user's changes to the session's state. `scale`: pixels of this screen that are one of an ordinary
// one.
#pragma once

#include "isobrick/viewer/session/view_session.h"

namespace isobrick {

// The step of time that is wanted, if there are `steps`.
void timeControls(ViewSession& session, int steps);
// The isovalue of the active surface, between the histogram and the contour spectrum, both with all
// surfaces and suggestions.
void isovalueControls(ViewSession& session, float scale);
// How fine the surfaces are and where: focus, curvature, pixels; and how that is seen.
void detailControls(ViewSession& session);
void cutControls(ViewSession& session, float scale);
void appearanceControls(ViewSession& session, float scale);

// The pieces of the active surface, and which of them are shown.
void pieceControls(ViewSession& session, float scale);

Wishes measureControls(ViewSession& session);

// All of them.
Wishes buildControls(ViewSession& session, float scale);

}  // namespace isobrick
