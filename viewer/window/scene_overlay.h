// What is drawn over the scene to be read and taken hold of: the scale, the cube, arrows, the keys.
#pragma once

#include "isobrick/viewer/session/view_session.h"

namespace isobrick {

// With Dear ImGui, between its begin and its end of a frame. `hovers`: the cursor is over the
// scene.
void buildOverlay(ViewSession& session, float scale, bool hovers);

}  // namespace isobrick
