// Pictures from all around a surface.
#pragma once

#include <vector>

#include "isobrick/viewer/offscreen_renderer.h"
#include "tools/render/picture_surface.h"

namespace isobrick {

// `count` pictures like `options`, to the right in equal steps from its azimuth on. The eye stays
// as far away as all of the surface needs from any side, so that it turns in its place.
std::vector<RenderOptions> turntable(const RenderOptions& options, const PictureSurface& surface,
                                     int count);

}  // namespace isobrick
