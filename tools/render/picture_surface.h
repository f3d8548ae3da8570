// An extracted surface in the form in which pictures are drawn.
#pragma once

#include "isobrick/viewer/offscreen_renderer.h"
#include "tools/query_options.h"

namespace isobrick {

// `view` gets the isovalue and the sphere of interest. If it colours by components, vertices have
// the colours of their pieces, for which the surface is extracted twice.
DrawableSurface extractPictureSurface(QueryOptions options, ViewState& view);

// From the direction of `camera`, as near as all of the surface is in the picture; if the camera
// `turns`, as far away as all of it needs from any side, so that it turns in its place.
ViewCamera cameraOf(const DrawableSurface& surface, const ViewCamera& camera, double aspect,
                    bool turns);

}  // namespace isobrick
